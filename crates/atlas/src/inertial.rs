//! What an inertial sensor says of a key frame.

use crate::KeyFrameId;
use cairn_geometry::{So3, Vec3};
use cairn_inertial::{Bias, Preintegrated};
use cairn_sensor::{ImuSample, Stamp};
use std::sync::Arc;

/// Seconds that a link spans at most.
const LONGEST_S: f64 = 5.0;

/// How the sensor moved at a key frame, and what it felt on the way there.
#[derive(Clone, Debug)]
pub struct InertialState {
    /// Velocity of the sensor along the eye's axes, m/s: it turns with the key frame when that is moved. Zero until the
    /// world is level.
    pub velocity: Vec3,
    /// The sensor's biases.
    pub bias: Bias,
    /// What was felt since an earlier key frame; none where readings are missing, or after the map was saved.
    pub imu_factor: Option<ImuFactor>,
}

/// What comes with a frame that may become a key frame.
#[derive(Clone, Debug, PartialEq)]
pub struct ImuSegment {
    /// As in [`InertialState`].
    pub velocity: Vec3,
    /// As in [`InertialState`].
    pub bias: Bias,
    /// Up along the eye's axes, as the force that was felt has it: off by as much as the eye was speeding up.
    pub up: Option<Vec3>,
    /// The readings since the frame that was offered before, both ends interpolated; empty where some are missing. In the
    /// images' clock as far as the map knows it ([`crate::Snapshot::imu_offset`]).
    pub samples: Vec<ImuSample>,
    /// What was added to their stamps for that, seconds.
    pub offset_s: f64,
    /// Directions seen since that frame, `world_from_camera`.
    pub turns: Vec<(Stamp, So3)>,
}

/// Readings between two key frames.
#[derive(Clone, Debug)]
pub struct ImuFactor {
    /// The earlier key frame, of the same world.
    pub since: KeyFrameId,
    /// The sum of the readings, from its stamp to that of the later one.
    pub sum: Arc<Preintegrated>,
}

impl ImuFactor {
    /// What was felt since the key frame at which `before` begins, when the one between goes; none over so long a time
    /// that it would say nothing.
    pub(crate) fn after(&self, before: &ImuFactor) -> Option<Self> {
        if before.sum.seconds() + self.sum.seconds() > LONGEST_S {
            return None;
        }
        let mut sum = (*before.sum).clone();
        sum.append(&self.sum);
        Some(Self { since: before.since, sum: Arc::new(sum) })
    }
}
