//! What is known of the unit of length of each map, and on which IMU the camera of an atlas is mounted.
//!
//! A map without a stated standard deviation, of a program that did not keep it or of a camera with depth, has that of its sensors.

use crate::{MapId, Snapshot};
use cairn_geometry::Se3;
use cairn_vision::RectifiedCamera;

/// Standard deviation of the logarithm of scale of cameras with depth, stereo or RGB-D. In `docs/figures/visual-inertial.md` it is 0.0018 and 0.0011 (root
/// mean squares of six and five motions, with exact calibrations); baselines and focal lengths are known to one or two thousandths.
pub const DEPTH_SCALE_SIGMA: f64 = 0.003;
/// That of a map of which depth relates most key frames to others, measured on simulated walks around a house with exact calibrations
/// (`docs/figures/dense.md`).
pub const RELATED_SCALE_SIGMA: f64 = 0.002;
/// That of a map with metres from an IMU which nobody stated: an initialisation is accepted up to it.
pub const INERTIAL_SCALE_SIGMA: f64 = 0.03;

/// What is known of the unit of length of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MapScale {
    /// Nothing.
    Unknown,
    /// It was guessed by the walking pace, against the earlier map that the map's prior refers to.
    Guessed {
        /// Standard deviation of the natural logarithm of the scale between the two maps.
        sigma_log: f64,
    },
    /// It is a metre.
    Metric {
        /// Standard deviation of the natural logarithm of metres in a unit.
        sigma_log: f64,
    },
}

impl MapScale {
    /// Standard deviation of the natural logarithm of metres in a unit, where it is a metre.
    pub fn metric_sigma(self) -> Option<f64> {
        match self {
            Self::Metric { sigma_log } => Some(sigma_log),
            Self::Unknown | Self::Guessed { .. } => None,
        }
    }
}

impl Snapshot {
    /// What is known of the unit of length of a map; `camera` is that of the atlas.
    pub fn scale_of(&self, map: MapId, camera: &RectifiedCamera) -> MapScale {
        if self.is_metric_in(map, camera) {
            let of_sensors = match self.has_depth_in(map, camera) {
                true if self.are_related(map) => RELATED_SCALE_SIGMA,
                true => DEPTH_SCALE_SIGMA,
                false => INERTIAL_SCALE_SIGMA,
            };
            return MapScale::Metric { sigma_log: self.stated_scale_sigma(map).unwrap_or(of_sensors) };
        }
        match self.maps.get(&map) {
            Some(Some(prior)) => MapScale::Guessed { sigma_log: prior.sigma_log_scale },
            _ => MapScale::Unknown,
        }
    }

    /// Whether depth relates most key frames of a map to others.
    fn are_related(&self, map: MapId) -> bool {
        let (related, all) = self
            .key_frames_of(map)
            .fold((0, 0), |(n, all), k| (n + usize::from(!k.relative_poses.is_empty()), all + 1));
        2 * related > all
    }

    /// The standard deviation that was stated for a map ([`crate::Change::ScaleSigma`]): of the natural logarithm of metres in a unit.
    pub fn stated_scale_sigma(&self, map: MapId) -> Option<f64> {
        self.scale_sigmas.get(&map).copied()
    }

    /// Pose of the atlas's camera on the IMU of its IMU factors, metres; `None` where there is none, or it is not known.
    pub fn imu_from_camera(&self) -> Option<&Se3> {
        self.imu_from_camera.as_ref()
    }

    /// The same snapshot with this pose of the camera on the IMU. Readings of an IMU that was mounted otherwise are left out.
    pub fn with_imu_from_camera(&self, imu_from_camera: Se3) -> Self {
        let other = self.imu_from_camera.is_some_and(|was| !is_same_mount(&was, &imu_from_camera));
        let snapshot = match other {
            true => self.without_imu_factors_where(|k| k.other_camera.is_none()),
            false => self.clone(),
        };
        Self { imu_from_camera: Some(imu_from_camera), ..snapshot }
    }

    /// The same, without readings of an IMU of which is not known that it was mounted so.
    pub(crate) fn of_mount(&self, imu_from_camera: Se3) -> Self {
        match self.imu_from_camera {
            Some(_) => self.with_imu_from_camera(imu_from_camera),
            None => {
                let without = self.without_imu_factors_where(|k| k.other_camera.is_none());
                without.with_imu_from_camera(imu_from_camera)
            }
        }
    }
}

/// Whether two poses of a camera on an IMU are those of one rig: within a millimetre and a milliradian, less than calibrations are off.
fn is_same_mount(a: &Se3, b: &Se3) -> bool {
    let off = a.inverse() * *b;
    off.translation.norm() < 1e-3 && off.rotation.angle() < 1e-3
}

/// Whether this can be a standard deviation of the logarithm of scale.
pub(crate) fn is_sound_sigma(sigma_log: f64) -> bool {
    sigma_log.is_finite() && sigma_log > 0.0
}
