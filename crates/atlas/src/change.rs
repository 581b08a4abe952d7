//! Changes to a map, as data.

use crate::{KeyFrame, KeyFrameId, LandmarkId};
use cairn_geometry::{Se3, Vec3};

/// One change.
#[derive(Clone, Debug)]
pub enum Change {
    /// A new key frame, without observations.
    AddKeyFrame(Box<KeyFrame>),
    /// A new landmark at a place in the world; its observations follow.
    AddLandmark(LandmarkId, Vec3),
    /// A key frame is somewhere else: `world_from_eye`.
    MoveKeyFrame(KeyFrameId, Se3),
    /// A landmark is somewhere else.
    MoveLandmark(LandmarkId, Vec3),
    /// A feature of a key frame shows a landmark (and nothing else).
    Observe(LandmarkId, KeyFrameId, u16),
    /// A key frame no longer shows a landmark.
    Forget(LandmarkId, KeyFrameId),
    /// The first landmark is the second: its observations go over, and it is removed.
    Fuse(LandmarkId, LandmarkId),
    /// What is to be added to every measured right x, pixels.
    Calibrate(f64),
    /// A landmark is no more.
    RemoveLandmark(LandmarkId),
    /// A key frame is no more; what hangs on it hangs on its parent from now on.
    RemoveKeyFrame(KeyFrameId),
}

/// Changes made on one version of a map.
#[derive(Clone, Debug, Default)]
pub struct ChangeSet {
    /// The version they were made on.
    pub base: u64,
    /// In order.
    pub changes: Vec<Change>,
}

/// What became of a change set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Applied {
    /// Changes done.
    pub done: usize,
    /// Changes that named something gone, or that a rule of the map forbids: left out.
    pub dropped: usize,
}
