//! The inertial initialisation ([`cairn_inertial::initialise`]) of the last seconds of a chain of key frames: what it is
//! given of the map, and what it tells of its scale later.

use crate::triangulation::median_depth;
use cairn_adjust::ImuModel;
use cairn_atlas::{Change, DEPTH_SCALE_SIGMA, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_inertial::{Attempt, Initial, InitialiseConfig, Preintegrated, Scale, Seen, SeenPose, initialise};
use cairn_vision::RectifiedCamera;

/// Standard deviation of a key frame's orientation in an adjusted map, as an angle in pixels; its position
/// uncertainty is this angle at the median depth.
const SEEN_PIXELS: f64 = 0.5;
/// Seconds of key frames, up to the newest, used by the initialisation.
pub(crate) const INITIALISATION_S: f64 = 20.0;
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
}

impl CameraAndImu<'_> {
    /// The initialisation with the key frames of the last `seconds` of a chain.
    pub(crate) fn attempt(&self, snapshot: &Snapshot, chain: &[KeyFrameId], seconds: f64) -> Option<Attempt> {
        self.attempt_from(snapshot, chain, seconds, self.scale())
    }

    /// What the camera knows of the scale of its map.
    fn scale(&self) -> Scale {
        match self.camera.has_depth() {
            true => Scale::Known { sigma: DEPTH_SCALE_SIGMA },
            false => Scale::Free,
        }
    }

    /// The same with this knowledge of the scale.
    pub(crate) fn attempt_from(
        &self,
        snapshot: &Snapshot,
        chain: &[KeyFrameId],
        seconds: f64,
        scale: Scale,
    ) -> Option<Attempt> {
        let frames: Vec<&KeyFrame> = chain.iter().filter_map(|id| snapshot.key_frame(*id)).collect();
        let last = frames.last()?.frame.stamp;
        let frames: Vec<&KeyFrame> = frames.into_iter().filter(|k| last - k.stamp <= seconds).collect();
        let links: Option<Vec<Preintegrated>> = frames
            .iter()
            .skip(1)
            .map(|k| Some((*k.motion.as_ref()?.imu_factor.as_ref()?.sum).clone()))
            .collect();
        solved(snapshot, self, &frames, &links?, scale)
    }
}

/// The initialisation of these key frames; `links[k]` sums the readings from key frame `k` to `k + 1`.
pub fn initialise_key_frames(
    snapshot: &Snapshot,
    of: &CameraAndImu,
    frames: &[&KeyFrame],
    links: &[Preintegrated],
) -> Option<Attempt> {
    solved(snapshot, of, frames, links, of.scale())
}

fn solved(
    snapshot: &Snapshot,
    of: &CameraAndImu,
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
        ..InitialiseConfig::default()
    };
    Some(initialise(&seen, links, &of.imu.imu_from_camera, scale, &config))
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
    use crate::imu_walk::{NOISE, ToAndFro};
    use crate::synthetic::mono;
    use cairn_geometry::{Se3, Vec3};

    #[test]
    fn attempt_finds_scale_and_gravity_of_a_map_with_a_unit_of_its_own() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.6, tilt_rad: 0.1, factor: 0.5 }.map(48);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.001 };
        let attempt = of.attempt(atlas.latest(), &ids, INITIALISATION_S).expect("an attempt");
        let found = attempt.found.as_ref().expect("an estimate");
        assert!((found.scale * 0.5 - 1.0).abs() < 0.02, "{} m in a unit, {:?}", found.scale, attempt.gates);
        // Down is -z but for the tilt about x.
        let down = found.gravity.vector().normalize();
        assert!((down.angle(&-Vec3::z()) - 0.1).abs() < 0.01, "{down:?}");
        assert!(of.attempt(atlas.latest(), &[], INITIALISATION_S).is_none());
        // A chain whose links are not all there says nothing.
        assert!(of.attempt(atlas.latest(), &[ids[1], ids[0]], INITIALISATION_S).is_none());
    }

    #[test]
    fn a_scale_is_never_stated_better_than_a_guessed_lens_allows() {
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.6, tilt_rad: 0.0, factor: 1.0 }.map(48);
        let imu = ImuModel { imu_from_camera: Se3::identity(), noise: NOISE, others_times: 1.0 };
        let of = CameraAndImu { camera: &mono(), imu: &imu, offset_sigma_s: 0.001 };
        let found = of.attempt(atlas.latest(), &ids, INITIALISATION_S).unwrap().found.unwrap();
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
