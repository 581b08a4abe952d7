//! The data of all sensors for one frame.

use crate::{DepthImage, GrayImage, Stamp};
use cairn_geometry::Vec3;
use std::sync::Arc;

/// Standard gravity, m/s^2; places on earth differ by 0.3 %.
pub const GRAVITY_M_S2: f64 = 9.80665;

/// One reading of the inertial sensor, in the body (IMU) frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// Time of the measurement.
    pub stamp: Stamp,
    /// Angular rate in rad/s.
    pub gyro: Vec3,
    /// Specific force in m/s^2 (about +9.8 along the upward axis at rest).
    pub accel: Vec3,
    /// Factor on the sensor's noise: 1 for a real sample, more for one synthesised by the merge.
    pub noise_scale: f64,
}

impl ImuSample {
    /// A real sample.
    pub fn new(stamp: Stamp, gyro: Vec3, accel: Vec3) -> Self {
        Self { stamp, gyro, accel, noise_scale: 1.0 }
    }

    /// True when the merge synthesised it because no real sample had arrived in time.
    pub fn is_synthesised(&self) -> bool {
        self.noise_scale != 1.0
    }
}

/// The images of one frame and the IMU samples since the previous packet.
#[derive(Clone, Debug)]
pub struct FramePacket {
    /// Time of exposure.
    pub stamp: Stamp,
    /// One image per camera of the rig, in the order of the rig; shared and immutable.
    pub images: Vec<Arc<GrayImage>>,
    /// The depth image, when the rig has a depth sensor and it delivered an image for this frame.
    pub depth: Option<Arc<DepthImage>>,
    /// Samples since the last one of the previous packet, up to the first at or after the image, in the clock of the
    /// images. The times of real samples increase strictly from packet to packet. If no sample at or after the image
    /// arrived in time, the last one is synthesised at the image's stamp from a sample at most one period old (see
    /// [`ImuSample::is_synthesised`]); it is outside that order: the real samples of the next packet replace it. See
    /// [`crate::Merge`].
    pub imu: Vec<ImuSample>,
    /// Time spent on reading and decoding this packet, milliseconds.
    pub decode_ms: f64,
}
