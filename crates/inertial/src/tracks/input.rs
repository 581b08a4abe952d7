//! What a motion by tracks is given.

use crate::Preintegrated;
use cairn_geometry::Se3;

/// A feature in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPoint {
    /// The frame's number.
    pub frame: usize,
    /// Its ray `(x, y, 1)` in the camera.
    pub ray: [f64; 2],
    /// By how much that changes for each second that the rows take longer to be read out; zero where that is known.
    pub by_readout: [f64; 2],
}

/// Frames with the readings between them, and the features found again.
#[derive(Clone, Copy, Debug)]
pub struct Tracks<'a> {
    /// The readings from each frame to the next.
    pub links: &'a [Preintegrated],
    /// Where each point was seen.
    pub tracks: &'a [Vec<TrackPoint>],
    /// Pose of the camera on the IMU, metres.
    pub imu_from_camera: Se3,
    /// What is known before.
    pub priors: TrackPriors,
}

/// Standard deviations of what is known before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackPriors {
    /// Of a ray.
    pub ray: f64,
    /// Of the biases: rad/s, m/s^2.
    pub bias: [f64; 2],
    /// Of the offset between the clocks of readings and frames, seconds.
    pub offset_s: f64,
    /// Of the logarithm of the focal length.
    pub log_focal: f64,
    /// Of the readout time, seconds.
    pub readout_s: f64,
}
