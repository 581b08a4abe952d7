//! One instant of all sensors.

use crate::{DepthImage, GrayImage, Stamp};
use cairn_geometry::Vec3;
use std::sync::Arc;

/// One reading of the inertial sensor, in the body (IMU) frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// When it was taken.
    pub stamp: Stamp,
    /// Angular rate in rad/s.
    pub gyro: Vec3,
    /// Specific force in m/s^2 (about +9.8 upwards at rest).
    pub accel: Vec3,
}

/// The images of one instant and the IMU samples since the packet before.
#[derive(Clone, Debug)]
pub struct FramePacket {
    /// Time of exposure.
    pub stamp: Stamp,
    /// One image per camera of the rig, in its order; shared, never changed.
    pub images: Vec<Arc<GrayImage>>,
    /// The depth image, when the rig has a depth sensor and this instant a reading.
    pub depth: Option<Arc<DepthImage>>,
    /// Samples in (previous packet, this packet], in strictly increasing time, with one at or after the image where the source has it.
    pub imu: Vec<ImuSample>,
    /// Milliseconds spent on reading and decoding this packet.
    pub decode_ms: f64,
}
