//! The inertial initialisation ([`cairn_inertial::initialise`]) of the last seconds of a chain of key frames: what it is
//! given of the map, and what it tells of its scale later.

use crate::triangulation::median_depth;
use cairn_adjust::ImuModel;
use cairn_atlas::{Change, DEPTH_SCALE_SIGMA, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_inertial::{
    Attempt, Initial, InitialiseConfig, NavState, Preintegrated, Scale, Seen, SeenPose, initialise_in_slices,
};
use cairn_solve::to_end;
use cairn_vision::RectifiedCamera;
use std::sync::Arc;

/// Standard deviation of a key frame's orientation in an adjusted map, as an angle in pixels; its position
/// uncertainty is this angle at the median depth.
const SEEN_PIXELS: f64 = 0.5;
/// Seconds of key frames, up to the newest, used by the initialisation.
pub(crate) const INITIALISATION_S: f64 = 20.0;
/// Key frames of an initialisation of a camera with a rolling shutter lie so far apart at least, seconds. Closer ones err together, for
/// they see the same landmarks from the same places: they cost time and tell little (`phone/b` has 7 to 20 a second, and took a quarter of
/// its processor time for them).
const APART_S: f64 = 0.15;
/// Below this speed the camera counts as stationary, m/s.
pub(crate) const STATIONARY_M_S: f64 = 0.05;

/// Camera and IMU of the key frames.
#[derive(Clone, Copy, Debug)]
pub struct CameraAndImu<'a> {
    /// The camera.
    pub camera: &'a RectifiedCamera,
    /// The IMU.
    pub imu: &'a ImuModel,
    /// Standard deviation of the offset between their clocks, seconds.
    pub offset_sigma_s: f64,
    /// Standard deviation of where the camera is on the IMU, each axis, metres.
    pub lever_arm_sigma: f64,
}

impl CameraAndImu<'_> {
    /// The initialisation with the key frames of the last `seconds` of a chain.
    pub(crate) async fn attempt(
        &self,
        snapshot: &Snapshot,
        chain: &[KeyFrameId],
        seconds: f64,
    ) -> Option<Attempt> {
        self.attempt_from(snapshot, chain, seconds, self.scale()).await
    }

    /// What the camera knows of the scale of its map.
    fn scale(&self) -> Scale {
        match self.camera.has_depth() {
            true => Scale::Known { sigma: DEPTH_SCALE_SIGMA },
            false => Scale::Free,
        }
    }

    /// The same with this knowledge of the scale.
    pub(crate) async fn attempt_from(
        &self,
        snapshot: &Snapshot,
        chain: &[KeyFrameId],
        seconds: f64,
        scale: Scale,
    ) -> Option<Attempt> {
        let frames: Vec<&KeyFrame> = chain.iter().filter_map(|id| snapshot.key_frame(*id)).collect();
        let last = frames.last()?.frame.stamp;
        let frames: Vec<&KeyFrame> = frames.into_iter().filter(|k| last - k.stamp <= seconds).collect();
        let link = |k: &&KeyFrame| Some(k.motion.as_ref()?.imu_factor.as_ref()?.sum.clone());
        let links: Vec<Arc<Preintegrated>> = frames.iter().skip(1).map(link).collect::<Option<_>>()?;
        let apart_s = if snapshot.readout().is_rolling() { APART_S } else { 0.0 };
        let used = apart(&frames, apart_s);
        let sums: Vec<Preintegrated> = used.windows(2).map(|ends| joined(&links[ends[0]..ends[1]])).collect();
        let of_used: Vec<&KeyFrame> = used.iter().map(|k| frames[*k]).collect();
        let mut attempt = solved(snapshot, self, &of_used, &sums, scale).await?;
        if let Some(found) = &mut attempt.found {
            found.states = with_those_between(found, &used, &links);
        }
        Some(attempt)
    }
}

/// The first and the last of the key frames, and those between them that lie so many seconds apart.
fn apart(frames: &[&KeyFrame], seconds: f64) -> Vec<usize> {
    let mut used: Vec<usize> = Vec::new();
    for k in (0..frames.len()).rev() {
        if k == 0 || used.last().is_none_or(|later| frames[*later].stamp - frames[k].stamp >= seconds) {
            used.push(k);
        }
    }
    used.reverse();
    used
}

/// The readings of several links in a row.
fn joined(links: &[Arc<Preintegrated>]) -> Preintegrated {
    let mut sum = (*links[0]).clone();
    links[1..].iter().for_each(|next| sum.append(next));
    sum
}

/// The states of all key frames from those of the ones that were used; the readings lead from each to those after it.
fn with_those_between(found: &Initial, used: &[usize], links: &[Arc<Preintegrated>]) -> Vec<NavState> {
    let mut states = Vec::with_capacity(links.len() + 1);
    for (state, (from, to)) in
        found.states.iter().zip(used.iter().zip(used[1..].iter().chain([&(links.len() + 1)])))
    {
        states.push(*state);
        for link in &links[*from..to - 1] {
            let mut link = (**link).clone();
            link.follow(&found.bias);
            let next = link.predict(&states[states.len() - 1], &found.gravity.vector());
            states.push(next);
        }
    }
    states
}

/// The initialisation of these key frames; `links[k]` sums the readings from key frame `k` to `k + 1`.
pub fn initialise_key_frames(
    snapshot: &Snapshot,
    of: &CameraAndImu,
    frames: &[&KeyFrame],
    links: &[Preintegrated],
) -> Option<Attempt> {
    to_end(solved(snapshot, of, frames, links, of.scale()))
}

async fn solved(
    snapshot: &Snapshot,
    of: &CameraAndImu<'_>,
    frames: &[&KeyFrame],
    links: &[Preintegrated],
    scale: Scale,
) -> Option<Attempt> {
    let poses: Vec<SeenPose> =
        frames.iter().map(|k| SeenPose { stamp: k.stamp, world_from_camera: k.world_from_camera }).collect();
    let rotation_sigma = SEEN_PIXELS / of.camera.fx;
    let position_sigma = rotation_sigma * median_depth(snapshot, frames.last()?)?;
    let seen = Seen { poses: &poses, rotation_sigma, position_sigma };
    // `initialise` raises the noise itself, starting from that of the data sheet.
    let config = InitialiseConfig {
        noise_times: 1.0,
        offset_sigma_s: of.offset_sigma_s,
        lever_arm_sigma: of.lever_arm_sigma,
        ..InitialiseConfig::default()
    };
    Some(initialise_in_slices(&seen, links, &of.imu.imu_from_camera, scale, &config).await)
}

/// The change that states how well the scale of a metric map is known once it is adjusted as a whole, where what the readings of the last
/// seconds say of it agrees with the map and is known better than was stated. It is not added to what earlier readings said: the error
/// of the accelerometer's sensitivity is common to both. `guessed` is what a lens that is a guess does to the scale, relative.
pub(crate) fn better_scale(snapshot: &Snapshot, map: MapId, found: &Initial, guessed: f64) -> Option<Change> {
    let (stated, sigma) = (snapshot.stated_scale_sigma(map)?, found.scale_sigma.hypot(guessed));
    let agrees = found.scale.ln().abs() < 2.0 * sigma;
    (agrees && sigma < stated).then_some(Change::ScaleSigma(map, sigma))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{NOISE, STEP_S, ToAndFro};
    use crate::synthetic::mono;
    use cairn_geometry::{Se3, Vec3};
    use cairn_sensor::Stamp;

    #[test]
    fn attempt_finds_scale_and_gravity_of_a_map_with_a_unit_of_its_own() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.6, tilt_rad: 0.1, factor: 0.5 }.map(48);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.001, lever_arm_sigma: 0.0 };
        let attempt = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).expect("an attempt");
        let found = attempt.found.as_ref().expect("an estimate");
        assert!((found.scale * 0.5 - 1.0).abs() < 0.02, "{} m in a unit, {:?}", found.scale, attempt.gates);
        // Down is -z but for the tilt about x.
        let down = found.gravity.vector().normalize();
        assert!((down.angle(&-Vec3::z()) - 0.1).abs() < 0.01, "{down:?}");
        assert!(to_end(of.attempt(atlas.latest(), &[], INITIALISATION_S)).is_none());
        // A chain whose links are not all there says nothing.
        assert!(to_end(of.attempt(atlas.latest(), &[ids[1], ids[0]], INITIALISATION_S)).is_none());
    }

    #[test]
    fn key_frames_that_are_close_are_not_asked_and_get_a_velocity_all_the_same() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.6, tilt_rad: 0.0, factor: 1.0 }.map(12);
        let frames: Vec<&KeyFrame> = ids.iter().filter_map(|id| atlas.latest().key_frame(*id)).collect();
        assert_eq!(apart(&frames, APART_S).len(), 12, "{STEP_S} s apart");
        let mut closer: Vec<KeyFrame> = frames.iter().copied().cloned().collect();
        let stamps = (0..).map(|k| Stamp::from_seconds(0.06 * f64::from(k)));
        closer.iter_mut().zip(stamps).for_each(|(k, stamp)| k.stamp = stamp);
        assert_eq!(apart(&closer.iter().collect::<Vec<_>>(), APART_S), [0, 2, 5, 8, 11]);
        let link = |k: &&KeyFrame| k.motion.as_ref().unwrap().imu_factor.as_ref().unwrap().sum.clone();
        let links: Vec<Arc<Preintegrated>> = frames[1..].iter().map(link).collect();
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.001, lever_arm_sigma: 0.0 };
        let found = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).unwrap().found.unwrap();
        let used = [0, 3, 4, 8, 11];
        let fewer = Initial { states: used.map(|k| found.states[k]).to_vec(), ..found.clone() };
        let states = with_those_between(&fewer, &used, &links);
        assert_eq!(states.len(), found.states.len());
        for (state, all) in states.iter().zip(&found.states) {
            let off = (state.velocity - all.velocity).norm();
            assert!(off < 0.05, "{off} m/s");
        }
    }

    #[test]
    fn a_scale_is_never_stated_better_than_a_guessed_lens_allows() {
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.6, tilt_rad: 0.0, factor: 1.0 }.map(48);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.001, lever_arm_sigma: 0.0 };
        let found = to_end(of.attempt(atlas.latest(), &ids, INITIALISATION_S)).unwrap().found.unwrap();
        let map = MapId(ids[0]);
        atlas.commit(vec![Change::ScaleSigma(map, 0.05)]);
        let stated = |guessed| match better_scale(atlas.latest(), map, &found, guessed) {
            Some(Change::ScaleSigma(_, sigma)) => Some(sigma),
            _ => None,
        };
        assert!(stated(0.0).is_some_and(|sigma| sigma < 0.03), "{:?}", stated(0.0));
        assert!(stated(0.03).is_some_and(|sigma| (0.03..0.05).contains(&sigma)), "{:?}", stated(0.03));
        assert_eq!(stated(0.06), None);
    }
}
