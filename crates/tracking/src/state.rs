//! The result of tracking one frame, and what is kept of it.

use crate::flow::FlowClocks;
use cairn_adjust::MotionSince;
use cairn_atlas::{ImuSegment, KeyFrameId, LandmarkId, MapId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use nalgebra::Matrix6;
use std::sync::Arc;

/// The state of tracking, with the numbers behind it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub enum State {
    /// No map yet: progress of the initialisation (features with depth, or matches between two views).
    Starting {
        /// Found so far.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// The pose is known.
    Tracking,
    /// Too few matches; the pose is predicted from the last visually tracked one by the IMU.
    Coasting {
        /// Seconds since the last visually tracked pose.
        since_s: f64,
        /// Standard deviation of the position, metres.
        sigma: f64,
    },
    /// The matches with the map are lost, but consecutive frames differ by a rotation alone: the orientation is
    /// tracked, the position is held at the last known pose.
    RotationOnly {
        /// Seconds since the last visually tracked pose.
        since_s: f64,
        /// Standard deviation of the position, in the map's unit.
        sigma: f64,
    },
    /// The pose is not known: `inliers` matches agreed where `need` are needed.
    Lost {
        /// Matches that agreed.
        inliers: usize,
        /// Matches needed.
        need: usize,
    },
}

/// A pose anchored to a key frame, so that it follows corrections of the map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnchoredPose {
    /// The key frame it is anchored to.
    pub reference: KeyFrameId,
    /// Pose of the camera in the camera frame of that key frame.
    pub reference_from_camera: Se3,
    /// Pose of the camera in the world frame of the snapshot it was computed with.
    pub world_from_camera: Se3,
}

impl AnchoredPose {
    /// The pose of the key frame itself.
    pub fn at(reference: KeyFrameId, world_from_camera: Se3) -> Self {
        Self { reference, reference_from_camera: Se3::identity(), world_from_camera }
    }
}

/// The evidence for a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Evidence {
    /// Features extracted.
    pub features: usize,
    /// Landmarks of the local map that should be in view.
    pub expected: usize,
    /// Matches before outlier rejection.
    pub matched: usize,
    /// Matches that agree with the pose.
    pub inliers: usize,
}

/// The prior pose of a new map in the previous one, when tracking was lost there and a new map begins
/// elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelocationPrior {
    /// The predicted pose, anchored to a key frame of the previous map.
    pub anchored: AnchoredPose,
    /// Standard deviation of the position, in the previous map's unit of length.
    pub sigma: f64,
    /// Standard deviation of the orientation, radians.
    pub sigma_rad: f64,
    /// Speed of the camera there, in the previous map's unit per second: sets the scale of a new map that has
    /// no metric scale.
    pub speed: Option<f64>,
    /// Standard deviation of the logarithm of the new map's scale against the previous one's.
    pub sigma_log_scale: f64,
    /// Whether the orientation comes from a gravity-aligned map, so that a new map with depth is
    /// gravity-aligned from the start.
    pub gravity_aligned: bool,
    /// Where scale had lost its support: the first key frame since. It and the later ones rest on assumed depths, and
    /// are removed when the new map begins.
    pub assumed_since: Option<KeyFrameId>,
}

/// A request to mapping to create key frames.
#[derive(Clone, Debug)]
pub enum KeyFrameRequest {
    /// The first key frame of a map: its features have depth.
    First {
        /// The frame.
        frame: Arc<Frame>,
        /// The prior pose in the previous map, if there is one.
        relocation_prior: Option<RelocationPrior>,
        /// The IMU data that belongs to it.
        imu: Option<ImuSegment>,
    },
    /// The first two key frames of a map without depth, with the points seen in both.
    Pair {
        /// The earlier frame; its camera frame is the world frame.
        first: Arc<Frame>,
        /// The later frame.
        second: Arc<Frame>,
        /// Pose of the second camera in the first; the baseline has unit length.
        first_from_second: Se3,
        /// Feature in the first, feature in the second, point in the first camera's frame.
        points: Vec<(u16, u16, Vec3)>,
        /// The prior pose of the first in the previous map, if there is one.
        relocation_prior: Option<RelocationPrior>,
        /// The IMU data of the second, with the readings since the first.
        imu: Option<ImuSegment>,
        /// Of the first map: what the flow of features has told of clocks and rows; the IMU data has that offset.
        clocks: Option<FlowClocks>,
    },
    /// A further key frame.
    Next {
        /// The frame.
        frame: Arc<Frame>,
        /// The landmark each feature shows.
        landmarks: Vec<Option<LandmarkId>>,
        /// Its pose.
        anchored: AnchoredPose,
        /// The IMU data that belongs to it.
        imu: Option<ImuSegment>,
        /// Whether nothing supports scale: the key frame only carries the orientation on.
        orientation_only: bool,
        /// The factor by which the map's lengths are to be multiplied first, and the standard deviation of the
        /// logarithm of its scale against the previous map after that.
        rescale: Option<(f64, f64)>,
        /// What other sensors measured of the camera's motion since the frame of the request before.
        motion: Option<MotionSince>,
        /// Whether poses are those of the depth, and stay where it found them.
        by_depth: bool,
    },
}

impl KeyFrameRequest {
    /// A further key frame at a pose that features have not given: it shows no landmark yet.
    pub(crate) fn carried(
        frame: Arc<Frame>,
        anchored: AnchoredPose,
        imu: Option<ImuSegment>,
        orientation_only: bool,
    ) -> Self {
        let landmarks = vec![None; frame.len()];
        Self::Next {
            frame,
            landmarks,
            anchored,
            imu,
            orientation_only,
            rescale: None,
            motion: None,
            by_depth: false,
        }
    }

    /// When the newest of its frames was taken.
    pub(crate) fn stamp(&self) -> Stamp {
        match self {
            Self::First { frame, .. } | Self::Next { frame, .. } => frame.stamp,
            Self::Pair { second, .. } => second.stamp,
        }
    }
}

/// The result of tracking one frame.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Time of the frame.
    pub stamp: Stamp,
    /// The state of tracking.
    pub state: State,
    /// The pose, when it is known.
    pub pose: Option<AnchoredPose>,
    /// Covariance of `pose.world_from_camera` in its map: of the right perturbation, translation and rotation of the camera.
    /// It is that of matches, IMU and measured motion; the landmarks count as exact, so what the map itself is off is not in
    /// it. Zero where the frame began the map.
    pub covariance: Option<Matrix6<f64>>,
    /// The evidence for it.
    pub evidence: Evidence,
    /// A request to mapping, when this frame should become a key frame or start a map.
    pub request: Option<KeyFrameRequest>,
    /// Poses of frames from before the initialisation, found once there was a map: time and pose.
    pub earlier: Vec<(Stamp, AnchoredPose)>,
    /// False while nothing determines the unit of length: no depth, no IMU, no landmark with parallax.
    pub scale_supported: bool,
    /// Landmarks that should have been in view, each with whether it was matched as an inlier.
    pub seen: Vec<(LandmarkId, bool)>,
}

impl Tracked {
    /// A frame without a pose.
    pub(crate) fn without_pose(stamp: Stamp, state: State, evidence: Evidence) -> Self {
        Self {
            stamp,
            state,
            pose: None,
            covariance: None,
            evidence,
            request: None,
            earlier: Vec::new(),
            scale_supported: true,
            seen: Vec::new(),
        }
    }
}

/// What is kept of the last frame that had a pose.
#[derive(Debug)]
pub(crate) struct Last {
    pub frame: Arc<Frame>,
    pub landmarks: Vec<Option<LandmarkId>>,
    pub anchored: AnchoredPose,
}

impl Last {
    /// A frame that shows no landmark, at a pose.
    pub fn without_landmarks(frame: Arc<Frame>, anchored: AnchoredPose) -> Self {
        Self { landmarks: vec![None; frame.len()], frame, anchored }
    }

    /// The key frame to which its pose is anchored, or what it was merged into.
    pub fn reference(&self, snapshot: &Snapshot) -> Option<KeyFrameId> {
        Some(snapshot.surviving_ancestor(self.anchored.reference)?.0)
    }
}

/// The map that a key frame is in, or the map it was merged into.
pub(crate) fn map_of(snapshot: &Snapshot, id: KeyFrameId) -> Option<MapId> {
    let (id, _) = snapshot.surviving_ancestor(id)?;
    Some(snapshot.key_frame(id)?.map)
}

/// A pose anchored to a key frame.
pub(crate) fn anchored_at(
    snapshot: &Snapshot,
    reference: KeyFrameId,
    world_from_camera: Se3,
) -> Option<AnchoredPose> {
    let reference_from_camera = snapshot.anchor(reference, &world_from_camera)?;
    Some(AnchoredPose { reference, reference_from_camera, world_from_camera })
}
