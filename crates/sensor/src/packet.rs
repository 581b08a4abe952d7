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
    /// What to multiply the sensor's noise with: 1 for a real reading, more for one that the merge made up.
    pub noise_scale: f64,
}

impl ImuSample {
    /// A real reading.
    pub fn new(stamp: Stamp, gyro: Vec3, accel: Vec3) -> Self {
        Self { stamp, gyro, accel, noise_scale: 1.0 }
    }

    /// True when the merge made it up because no real one had come by then.
    pub fn is_synthesised(&self) -> bool {
        self.noise_scale != 1.0
    }
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
    /// Samples since the last one of the packet before, up to the first at or after the image. Real samples rise strictly
    /// in time from packet to packet and come in the clock of the images. Where none at or after the image has come in time, a
    /// last one is made up at the image's stamp from one at most a period old (see [`ImuSample::is_synthesised`]); it stands
    /// outside that order: the next packet's real samples take its place. See [`crate::Merge`].
    pub imu: Vec<ImuSample>,
    /// Milliseconds spent on reading and decoding this packet.
    pub decode_ms: f64,
}
