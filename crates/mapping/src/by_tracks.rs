//! Metres for a young map of one camera by its tracks and the readings ([`cairn_inertial::motion_of_tracks`]): which features show one
//! thing is taken from the map, and nothing of where it has put them. So they come even where the unit of length has changed within the
//! map, as it does when someone turns before there are metres.

use crate::initialisation::CameraAndImu;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::{
    NavState, Preintegrated, TrackMotion, TrackPoint, TrackPriors, Tracks, motion_of_tracks,
};
use std::collections::BTreeMap;

/// Seconds of key frames, up to the newest.
const SECONDS: f64 = 5.0;
/// The least of them.
const LEAST_SECONDS: f64 = 1.5;
/// Standard deviation of a feature of the finest level that tracking has found again from a key frame to the next, pixels.
const SEEN_PX: f64 = 1.0;
/// Of the biases of a phone, rad/s and m/s^2.
const BIAS: [f64; 2] = [0.01, 0.15];
/// Of the logarithm of a focal length that is a guess.
const FOCAL: f64 = 0.05;
/// Scale and gravity known worse than this are not taken: relative, radians.
const MOST_SIGMA: [f64; 2] = [0.1, 0.04];
/// Greatest bias of an accelerometer, m/s^2. With one hardly moved (`phone/a`) noise is explained by 2 m/s^2 and a lens twice as long.
const MOST_ACCEL_BIAS: f64 = 1.0;
/// Who moves less than this has no metres: what an accelerometer is off while it is tilted is as large as what it feels. Hands that hold a
/// phone over a table move it by 0.2 m (`phone/a`), a walker goes a metre in the least time (`phone/b`).
const LEAST_MOVED_M: f64 = 0.3;
/// What a lens and extrinsics that are guesses do to the scale, which the rays do not show: a focal length 4 % off, and axes 2 degrees off
/// (`phone/b`), relative.
pub(crate) const GUESSED: f64 = 0.03;
/// Rays that do not meet, in standard deviations, and the share of those that do.
const MOST_RESIDUAL: f64 = 2.5;
const LEAST_AGREEING: f64 = 0.7;

/// The motion of the last key frames of a chain.
pub(crate) struct Found {
    pub motion: TrackMotion,
    pub key_frames: Vec<KeyFrameId>,
    landmarks: Vec<LandmarkId>,
    /// What it follows from is good enough.
    pub is_good: bool,
}

/// Finds the motion of the last seconds of a chain of key frames.
pub(crate) async fn motion_of(
    snapshot: &Snapshot,
    of: &CameraAndImu<'_>,
    chain: &[KeyFrameId],
) -> Option<Found> {
    let frames: Vec<&KeyFrame> = chain.iter().filter_map(|id| snapshot.key_frame(*id)).collect();
    let newest = frames.last()?.stamp;
    let frames: Vec<&KeyFrame> = frames.into_iter().filter(|k| newest - k.stamp <= SECONDS).collect();
    if newest - frames.first()?.stamp < LEAST_SECONDS {
        return None;
    }
    let link = |k: &&KeyFrame| Some((*k.motion.as_ref()?.imu_factor.as_ref()?.sum).clone());
    let links: Option<Vec<Preintegrated>> = frames.iter().skip(1).map(link).collect();
    let (landmarks, tracks) = tracks(snapshot, of, &frames);
    let readout = snapshot.readout();
    let priors = TrackPriors {
        ray: SEEN_PX / of.camera.fx,
        bias: BIAS,
        offset_s: of.offset_sigma_s,
        log_focal: FOCAL,
        readout_s: readout.sigma_s,
    };
    let imu_from_camera = of.imu.imu_from_camera;
    let of_tracks = Tracks { links: &links?, tracks: &tracks, imu_from_camera, priors };
    let mut motion = motion_of_tracks(&of_tracks).await?;
    motion.scale_sigma = motion.scale_sigma.hypot(GUESSED);
    let is_good = motion.scale_sigma <= MOST_SIGMA[0]
        && motion.gravity_sigma <= MOST_SIGMA[1]
        && motion.residual <= MOST_RESIDUAL
        && motion.agreeing >= LEAST_AGREEING
        && motion.log_focal[0].abs() <= 2.0 * FOCAL
        && motion.states.first().is_some_and(|s| s.bias.accel.norm() <= MOST_ACCEL_BIAS)
        && moved_m(&motion) >= LEAST_MOVED_M;
    Some(Found { motion, key_frames: frames.iter().map(|k| k.id).collect(), landmarks, is_good })
}

/// How far the farthest place is from the first.
fn moved_m(motion: &TrackMotion) -> f64 {
    let Some(first) = motion.states.first() else { return 0.0 };
    let from_first = |s: &NavState| (s.world_from_imu.translation - first.world_from_imu.translation).norm();
    motion.states.iter().map(from_first).fold(0.0, f64::max)
}

/// What these key frames show of one thing.
fn tracks(
    snapshot: &Snapshot,
    of: &CameraAndImu,
    frames: &[&KeyFrame],
) -> (Vec<LandmarkId>, Vec<Vec<TrackPoint>>) {
    let mut tracks: BTreeMap<LandmarkId, Vec<TrackPoint>> = BTreeMap::new();
    let seconds = snapshot.readout().seconds;
    for (frame, k) in frames.iter().enumerate() {
        let camera = k.camera(of.camera);
        for (i, id) in k.landmarks.iter().enumerate() {
            let Some(id) = id else { continue };
            let [u, v, _] = k.frame.pixel_with(i, seconds);
            let by = k.frame.rolling.as_ref().map_or([0.0; 2], |r| r.slopes[i].map(f64::from));
            let point = TrackPoint {
                frame,
                ray: [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy],
                by_readout: [by[0] / camera.fx, by[1] / camera.fy],
            };
            tracks.entry(*id).or_default().push(point);
        }
    }
    tracks.into_iter().filter(|(_, track)| track.len() > 1).unzip()
}

impl Found {
    /// The changes that give a map metres and gravity, and its last key frames the motion; `imu_from_camera` in metres. Those before keep
    /// their shape.
    pub fn changes(&self, snapshot: &Snapshot, map: MapId, imu_from_camera: &Se3) -> Vec<Change> {
        let pose = |k: usize| self.motion.states[k].world_from_imu * *imu_from_camera;
        let Some(first) = self.key_frames.first().and_then(|id| snapshot.key_frame(*id)) else {
            return Vec::new();
        };
        let before = first.world_from_camera;
        let rotation = pose(0).rotation * before.rotation.inverse();
        // The first of them stays where it is.
        let there = Se3::new(So3::identity(), before.translation - pose(0).translation);
        let scale = self.metres_in_a_unit(snapshot, imu_from_camera);
        let shift = before.translation - rotation * before.translation * scale;
        let mut changes = vec![
            Change::AlignGravity(map, Sim3::new(rotation, shift, scale)),
            Change::ScaleSigma(map, self.motion.scale_sigma),
        ];
        for (k, id) in self.key_frames.iter().enumerate() {
            let (state, world_from_camera) = (&self.motion.states[k], there * pose(k));
            let velocity = world_from_camera.rotation.inverse() * state.velocity;
            changes.push(Change::MoveKeyFrame(*id, world_from_camera));
            changes.push(Change::InertialState(*id, velocity, state.bias));
        }
        let points = self.landmarks.iter().zip(&self.motion.points);
        changes.extend(points.filter_map(|(id, at)| Some(Change::MoveLandmark(*id, there * (*at)?))));
        changes
    }

    /// Metres in a unit of the map where these key frames begin.
    fn metres_in_a_unit(&self, snapshot: &Snapshot, imu_from_camera: &Se3) -> f64 {
        let half = (self.key_frames.len() / 2).max(1);
        let spread = |places: Vec<Vec3>| {
            let mean = places.iter().sum::<Vec3>() / places.len().max(1) as f64;
            places.iter().map(|p| (p - mean).norm_squared()).sum::<f64>().sqrt()
        };
        let of_map = self.key_frames[..half].iter().filter_map(|id| snapshot.key_frame(*id));
        let of_map = spread(of_map.map(|k| k.world_from_camera.translation).collect());
        let states = self.motion.states[..half].iter();
        let found = spread(states.map(|s| (s.world_from_imu * *imu_from_camera).translation).collect());
        if of_map > 0.0 && found > 0.0 { found / of_map } else { 1.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{NOISE, STEP_S, ToAndFro, position};
    use crate::synthetic::mono;
    use cairn_adjust::ImuModel;
    use cairn_atlas::Atlas;
    use cairn_solve::to_end;

    const COUNT: usize = 16;

    /// A map of vision, whose unit shrinks to a part of what it was at the eighth key frame.
    fn shrunk(part: f64) -> (Atlas, Vec<KeyFrameId>) {
        let walk = ToAndFro { turn_rad: 0.8, tilt_rad: 0.0, factor: 2.0 };
        let (mut atlas, ids) = walk.map_of_vision(COUNT);
        let snapshot = atlas.latest().clone();
        let pose = |id: KeyFrameId| snapshot.key_frame(id).unwrap().world_from_camera;
        let centre = pose(ids[8]).translation;
        let smaller = |p: Vec3| centre + (p - centre) * part;
        let mut changes: Vec<Change> = ids[8..]
            .iter()
            .map(|id| Change::MoveKeyFrame(*id, Se3::new(pose(*id).rotation, smaller(pose(*id).translation))))
            .collect();
        let new = snapshot.landmarks().filter(|l| l.observations[0].key_frame >= ids[8]);
        changes.extend(new.map(|l| Change::MoveLandmark(l.id, smaller(l.position))));
        atlas.commit(changes);
        (atlas, ids)
    }

    fn found(atlas: &Atlas, ids: &[KeyFrameId]) -> Option<Found> {
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.004, lever_arm_sigma: 0.0 };
        to_end(motion_of(atlas.latest(), &of, ids))
    }

    #[test]
    fn metres_come_where_the_unit_has_shrunk_within_the_map() {
        for part in [1.0, 0.2, 0.004] {
            let (mut atlas, ids) = shrunk(part);
            let found = found(&atlas, &ids).expect("a motion");
            assert!(found.is_good, "{part}: {} {}", found.motion.scale_sigma, found.motion.residual);
            let map = MapId(ids[0]);
            let changes = found.changes(atlas.latest(), map, &Se3::identity());
            assert_eq!(atlas.commit(changes).dropped, 0);
            assert!(atlas.latest().is_gravity_aligned(map));
            let place = |n: usize| atlas.latest().key_frame(ids[n]).unwrap().world_from_camera.translation;
            for (a, b) in [(0, 7), (4, 12), (8, 15)] {
                let real = (position(STEP_S * b as f64) - position(STEP_S * a as f64)).norm();
                let off = ((place(b) - place(a)).norm() / real).ln();
                assert!(off.abs() < 0.05, "{part}: from {a} to {b} {off}");
            }
        }
    }

    #[test]
    fn a_second_of_key_frames_has_no_metres() {
        let (atlas, ids) = shrunk(1.0);
        assert!(found(&atlas, &ids[..5]).is_none());
    }
}
