//! What the guide is given at each step.

use crate::cue::StopReason;
use crate::route::Confidence;
use cairn_geometry::{Camera, Odom, Pose};
use cairn_sensor::Stamp;

/// The input of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuideInput {
    /// The time now, in the clock of the poses.
    pub now: Stamp,
    /// The time of the pose.
    pub pose_stamp: Stamp,
    /// Pose of the camera (x right, y down, z forward) in the odom frame; the last known one when tracking is lost.
    pub odom_from_camera: Pose<Odom, Camera>,
    /// Tracking confidence of the pose.
    pub confidence: Confidence,
    /// Speed over ground in m/s, where a better source than the poses measures it.
    pub speed: Option<f64>,
    /// A reason to stop that another component reports: an obstacle, unknown ground, a failed stage.
    pub hazard: Option<StopReason>,
}
