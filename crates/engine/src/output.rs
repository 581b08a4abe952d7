//! What the engine says after each packet, and of the work that is finished after the last one: a pose, events and timings.

use crate::scale::Scale;
use crate::status::Status;
use cairn_geometry::{Body, Pose, World};
use cairn_inertial::Attempt;
use cairn_mapping::{ScaleCheck, Verdict};
use cairn_sensor::Stamp;
use cairn_tracking::{AnchoredPose, Evidence, Odometry, State};
use cairn_vision::{Frame, Misregistration};
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
    /// Where the body is, when that is known.
    pub pose: Option<FramePose>,
    /// The evidence for the pose.
    pub evidence: Evidence,
    /// Whether tracking asked mapping to make this frame a key frame; mapping may decline.
    pub key_frame_requested: bool,
    /// What mapping and closing did since the last packet.
    pub events: Vec<StageEvent>,
    /// How long it took.
    pub timings: Timings,
    /// The same for people.
    pub status: Status,
}

impl Output {
    /// The pose of the body in the map, when it is known.
    pub fn world_from_body(&self) -> Option<Pose<World, Body>> {
        self.pose.map(|pose| pose.world_from_body)
    }

    /// Whether there is a pose in metres.
    pub fn is_metric(&self) -> bool {
        self.pose.is_some_and(|pose| pose.scale.metric)
    }

    /// Verdicts of closing on places that may have been seen before.
    pub fn verdicts(&self) -> impl Iterator<Item = &Verdict> {
        self.events.iter().filter_map(StageEvent::verdict)
    }

    /// Why mapping failed, told once.
    pub fn stage_failed(&self) -> Option<&str> {
        self.events.iter().find_map(StageEvent::failed)
    }
}

/// The pose of a frame: in the map, in the odometry, at a key frame; and what is known of it.
#[derive(Clone, Copy, Debug)]
pub struct FramePose {
    /// The pose of the body in the map.
    pub world_from_body: Pose<World, Body>,
    /// The pose of the body in the odometry frame, which no correction of the map moves:
    /// `odometry.world_from_odom.then(&odometry.odom_from_body)` is `world_from_body`.
    pub odometry: Odometry,
    /// The camera pose (not the body's), anchored to a key frame.
    pub anchored: AnchoredPose,
    /// Covariance of `anchored.world_from_camera`, of its right perturbation: translation and rotation of the camera. The
    /// landmarks count as exact: what the map itself is off is not in it. Zero where the frame began the map.
    pub covariance: Option<SMatrix<f64, 6, 6>>,
    /// What is known of its unit of length. It is the metre with depth, else once the IMU has been initialised.
    pub scale: Scale,
}

/// What mapping or closing did.
#[derive(Clone, Debug)]
pub enum StageEvent {
    /// An attempt to initialise gravity, scale and biases, the last of several.
    Attempt(Box<Attempt>),
    /// What the IMU says of the scale of a metric map, where a key frame was checked.
    ScaleCheck(ScaleCheck),
    /// The verdict of closing on a place that may have been seen before.
    Verdict(Verdict),
    /// How the picture lies against the depth, which the rig says is registered to it: poses are those of the depth from here on.
    Misregistered(Misregistration),
    /// Why a stage failed, told once; tracking goes on with the map as it is.
    Failed(String),
}

impl StageEvent {
    /// The verdict on a place, if it is one.
    pub fn verdict(&self) -> Option<&Verdict> {
        if let Self::Verdict(verdict) = self { Some(verdict) } else { None }
    }

    /// The attempt to initialise, if it is one.
    pub fn attempt(&self) -> Option<&Attempt> {
        if let Self::Attempt(attempt) = self { Some(attempt.as_ref()) } else { None }
    }

    /// The check of the scale, if it is one.
    pub fn scale_check(&self) -> Option<&ScaleCheck> {
        if let Self::ScaleCheck(check) = self { Some(check) } else { None }
    }

    /// How the picture lies against the depth, where that was found.
    pub fn misregistered(&self) -> Option<&Misregistration> {
        if let Self::Misregistered(found) = self { Some(found) } else { None }
    }

    /// Why a stage failed, if one did.
    pub fn failed(&self) -> Option<&str> {
        if let Self::Failed(why) = self { Some(why) } else { None }
    }
}

/// How long things took, in milliseconds of the engine's clock.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timings {
    /// From the decoded image to features.
    pub extract_ms: f64,
    /// From features to the pose.
    pub track_ms: f64,
    /// Each key frame that mapping has finished since the last packet.
    pub map_ms: Vec<f64>,
    /// Each key frame in closing, and each adjustment of a whole map.
    pub close_ms: Vec<f64>,
}

impl Timings {
    /// From the decoded image to the pose.
    pub fn step_ms(&self) -> f64 {
        self.extract_ms + self.track_ms
    }
}

/// The work finished after the last packet.
#[derive(Clone, Debug, Default)]
pub struct Finished {
    /// As in [`Output`].
    pub events: Vec<StageEvent>,
    /// As in [`Output`]; no image was extracted or tracked.
    pub timings: Timings,
}

impl Finished {
    /// As [`Output::verdicts`].
    pub fn verdicts(&self) -> impl Iterator<Item = &Verdict> {
        self.events.iter().filter_map(StageEvent::verdict)
    }

    /// As [`Output::stage_failed`].
    pub fn stage_failed(&self) -> Option<&str> {
        self.events.iter().find_map(StageEvent::failed)
    }
}
