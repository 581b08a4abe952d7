//! What tracking tells of a frame.

use cairn_atlas::{ImuSegment, KeyFrameId, LandmarkId};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// Where tracking stands, with the numbers behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum State {
    /// No map yet: what the start has and what it needs (features with depth, or matches between two views).
    Starting {
        /// Found so far.
        have: usize,
        /// Needed.
        need: usize,
    },
    /// The pose is known.
    Tracking,
    /// Too little is seen; the pose is what the inertial sensor has made of the last that was seen.
    Coasting {
        /// Seconds since the pose was last seen.
        since_s: f64,
        /// Standard deviation of the place, metres.
        sigma: f64,
    },
    /// The pose is not known: this many matches agreed where `need` are needed.
    Lost {
        /// Agreed.
        inliers: usize,
        /// Needed.
        need: usize,
    },
}

/// A pose that follows the map: it hangs on a key frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AnchoredPose {
    /// The key frame it hangs on.
    pub reference: KeyFrameId,
    /// Where the eye stands in the key frame's eye frame.
    pub reference_from_camera: Se3,
    /// Where the eye stands in the world of the map version at hand.
    pub world_from_camera: Se3,
}

impl AnchoredPose {
    /// The pose of an eye that stands where a key frame does.
    pub fn at(reference: KeyFrameId, world_from_camera: Se3) -> Self {
        Self { reference, reference_from_camera: Se3::identity(), world_from_camera }
    }
}

/// What speaks for a pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Evidence {
    /// Features seen.
    pub features: usize,
    /// Landmarks of the local map that should be in view.
    pub expected: usize,
    /// Matches before the last judgement.
    pub matched: usize,
    /// Matches that agree with the pose.
    pub inliers: usize,
}

/// Where a new world is believed to begin in a former one, when tracking was lost there and goes on elsewhere.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelocationPrior {
    /// The place believed, hanging on a key frame of the former world.
    pub anchored: AnchoredPose,
    /// Standard deviation of the place, in the former world's unit of length.
    pub sigma: f64,
    /// Standard deviation of the direction, radians.
    pub sigma_rad: f64,
    /// How fast the eye went there, in the former world's unit a second: what a new world without scale begins with.
    pub pace: Option<f64>,
    /// Standard deviation of the logarithm of the new map's scale against the former one's.
    pub sigma_log_scale: f64,
    /// Whether the direction is that of a level world, so that a new one with depth is level from its begin.
    pub level: bool,
}

/// What mapping is offered.
#[derive(Clone, Debug)]
pub enum KeyFrameRequest {
    /// The first key frame of a world: its features have depth.
    First {
        /// The frame.
        frame: Arc<Frame>,
        /// Where that is believed to be, when there is a former world.
        relocation_prior: Option<RelocationPrior>,
        /// What the inertial sensor says of it.
        imu: Option<ImuSegment>,
    },
    /// The first two key frames of a world without depth, with the points that both see.
    Pair {
        /// The earlier frame; its eye is the world.
        first: Arc<Frame>,
        /// The later frame.
        second: Arc<Frame>,
        /// Where the second stands; the baseline has unit length.
        first_from_second: Se3,
        /// Feature in the first, feature in the second, point in the first eye's frame.
        points: Vec<(u16, u16, Vec3)>,
        /// Where the first is believed to be, when there is a former world.
        relocation_prior: Option<RelocationPrior>,
        /// What the inertial sensor says of the second, felt since the first.
        imu: Option<ImuSegment>,
    },
    /// A further key frame.
    Next {
        /// The frame.
        frame: Arc<Frame>,
        /// The landmark each feature shows.
        landmarks: Vec<Option<LandmarkId>>,
        /// Where it stands.
        anchored: AnchoredPose,
        /// What the inertial sensor says of it.
        imu: Option<ImuSegment>,
        /// Whether nothing supports scale: the key frame only carries orientation on.
        orientation_only: bool,
        /// The map's lengths are to be so many times what they were, and the standard deviation of the logarithm of its scale
        /// against the map before is then this.
        rescale: Option<(f64, f64)>,
    },
}

/// What became of a frame.
#[derive(Clone, Debug)]
pub struct Tracked {
    /// Time of the frame.
    pub stamp: Stamp,
    /// Where tracking stands.
    pub state: State,
    /// The pose, when it is known.
    pub pose: Option<AnchoredPose>,
    /// What speaks for it.
    pub evidence: Evidence,
    /// Something for mapping, when this frame is worth it.
    pub request: Option<KeyFrameRequest>,
    /// Poses of frames before the start, found once there was a map: time and pose.
    pub earlier: Vec<(Stamp, AnchoredPose)>,
    /// False while the unit of length rests on nothing: no depth, no inertial sensor, no landmark with parallax.
    pub scale_supported: bool,
    /// Landmarks that should have been in view, each with whether it was matched and agreed.
    pub seen: Vec<(LandmarkId, bool)>,
}
