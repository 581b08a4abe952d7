//! What the engine says after each packet, and of the work that is finished after the last one.

use crate::scale::Scale;
use crate::status::Status;
use cairn_geometry::{Body, Pose, World};
use cairn_inertial::Attempt;
use cairn_mapping::{ScaleCheck, Verdict};
use cairn_sensor::Stamp;
use cairn_tracking::{AnchoredPose, Evidence, Odometry, State};
use cairn_vision::Frame;
use nalgebra::SMatrix;
use std::sync::Arc;

/// The result of one packet.
#[derive(Clone, Debug)]
pub struct Output {
    /// Time of the packet.
    pub stamp: Stamp,
    /// The extracted features.
    pub frame: Arc<Frame>,
    /// The state of tracking.
    pub state: State,
    /// The pose of the body, when it is known.
    pub world_from_body: Option<Pose<World, Body>>,
    /// The pose of the body in the odometry frame, which no correction of the map moves; `None` when the pose is not
    /// known. `odometry.world_from_odom.then(&odometry.odom_from_body)` is `world_from_body`.
    pub odometry: Option<Odometry>,
    /// The camera pose (not the body's), anchored to a key frame.
    pub anchored: Option<AnchoredPose>,
    /// Covariance of `anchored.world_from_camera`, of its right perturbation: translation and rotation of the camera. The
    /// landmarks count as exact: what the map itself is off is not in it. Zero where the frame began the map.
    pub covariance: Option<SMatrix<f64, 6, 6>>,
    /// Whether lengths are metres in the map of the pose: always with depth, else once the IMU has been
    /// initialised.
    pub metric: bool,
    /// What is known of the unit of length of the pose.
    pub scale: Option<Scale>,
    /// The last attempt to initialise gravity, scale and biases, if there was one.
    pub attempt: Option<Attempt>,
    /// What the IMU says of the scale of a metric map, where a key frame was checked since the last packet.
    pub scale_check: Option<ScaleCheck>,
    /// The evidence for the pose.
    pub evidence: Evidence,
    /// Whether tracking asked mapping to make this frame a key frame; mapping may decline.
    pub key_frame_requested: bool,
    /// Milliseconds from the decoded image to features.
    pub extract_ms: f64,
    /// Milliseconds from features to the pose.
    pub track_ms: f64,
    /// Milliseconds of each key frame that mapping has finished since the last packet.
    pub map_ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole map.
    pub close_ms: Vec<f64>,
    /// Verdicts of closing on places that may have been seen before.
    pub verdicts: Vec<Verdict>,
    /// Why mapping failed, reported once; tracking goes on with the map as it is.
    pub stage_failed: Option<String>,
    /// The same for people.
    pub status: Status,
}

/// The work finished after the last packet.
#[derive(Clone, Debug, Default)]
pub struct Finished {
    /// As in [`Output`].
    pub map_ms: Vec<f64>,
    /// As in [`Output`].
    pub close_ms: Vec<f64>,
    /// As in [`Output`].
    pub verdicts: Vec<Verdict>,
}
