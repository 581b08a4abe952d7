//! The IMU data of a key frame.

use crate::KeyFrameId;
use cairn_geometry::{So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::{ImuSample, Stamp};
use std::sync::Arc;

/// Longest IMU factor, seconds.
const MAX_FACTOR_S: f64 = 5.0;

/// The inertial state of a key frame: velocity and biases, and the IMU factor to an earlier one.
#[derive(Clone, Debug)]
pub struct InertialState {
    /// Velocity of the IMU along the camera's axes, m/s: it rotates with the key frame when that is moved.
    /// Zero until the map is gravity-aligned.
    pub velocity: Vec3,
    /// The IMU's biases.
    pub bias: Bias,
    /// Where the camera is known not to move (it stands, or turns on the spot) although it sees no landmarks: the standard
    /// deviation of that, m/s.
    pub still_sigma: Option<f64>,
    /// The IMU factor to an earlier key frame; `None` where readings are missing.
    pub imu_factor: Option<ImuFactor>,
}

/// The IMU data that comes with a frame that may become a key frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuSegment {
    /// As in [`InertialState`].
    pub velocity: Vec3,
    /// As in [`InertialState`].
    pub bias: Bias,
    /// As in [`InertialState`].
    pub still_sigma: Option<f64>,
    /// The up direction in the camera frame by the mean specific force: off by as much as the camera was
    /// accelerating.
    pub up: Option<Vec3>,
    /// The readings since the frame of the previous request, both ends interpolated; empty where some are
    /// missing. In the images' clock as far as the map knows it ([`crate::Snapshot::imu_offset`]).
    pub samples: Vec<ImuSample>,
    /// Readings from then on, in the same clock, that earlier key frames were given have turned out not to be those of the motion.
    pub unsound_since: Option<Stamp>,
    /// The time offset that was added to their stamps, seconds.
    pub offset_s: f64,
    /// Orientations tracked since that frame, `world_from_camera`.
    pub turns: Vec<(Stamp, So3)>,
}

/// The preintegrated readings between two key frames.
#[derive(Clone, Debug)]
pub struct ImuFactor {
    /// The earlier key frame, of the same map.
    pub since: KeyFrameId,
    /// The preintegration of the readings, from its stamp to that of the later one.
    pub sum: Arc<Preintegrated>,
}

impl ImuFactor {
    /// This factor joined to the one `before` it, when the key frame in between is removed; `None` when the
    /// result would span too long a time to be informative.
    pub(crate) fn after(&self, before: &ImuFactor) -> Option<Self> {
        if before.sum.seconds() + self.sum.seconds() > MAX_FACTOR_S {
            return None;
        }
        let mut sum = (*before.sum).clone();
        sum.append(&self.sum);
        Some(Self { since: before.since, sum: Arc::new(sum) })
    }
}
