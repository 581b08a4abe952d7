//! Changes to a map, as data.

use crate::{ImuFactor, KeyFrame, KeyFrameId, LandmarkId, MapId, MapPrior};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::Bias;

/// One change.
#[derive(Clone, Debug)]
pub enum Change {
    /// A new key frame, without observations; one without a parent is the root of a new world.
    AddKeyFrame(Box<KeyFrame>),
    /// A new landmark at a place in the world; its observations follow.
    AddLandmark(LandmarkId, Vec3),
    /// A key frame is somewhere else: `world_from_camera`.
    MoveKeyFrame(KeyFrameId, Se3),
    /// Lengths around a key frame, in its own world, are this many times what they were.
    Scale(KeyFrameId, f64),
    /// The sensor of a key frame that has a motion moves like this: velocity along the eye's axes in m/s, and biases.
    InertialState(KeyFrameId, Vec3, Bias),
    /// What was felt on the way to a key frame that has a motion is this.
    ImuFactor(KeyFrameId, ImuFactor),
    /// Seconds to be added to the stamps of the inertial sensor, beyond what its source adds, to get the images' clock.
    ImuOffset(f64),
    /// Gravity and scale of a world are known, or known better: all that is in it moves by this, and from now on its
    /// lengths are metres and its z axis points up.
    AlignGravity(MapId, Sim3),
    /// Lengths in a map are this many times what they were, about the place of its root: its unit of length is better
    /// known than it was. The map is no more metric for it.
    Rescale(MapId, f64),
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
    /// A loop was closed between two key frames.
    Link(KeyFrameId, KeyFrameId),
    /// How a world hangs on a former one until they are merged.
    MapPrior(MapId, MapPrior),
    /// A younger world is part of an older one from now on: all that is in it moves by `into_from`, and its root hangs
    /// on `parent`, which is older than it.
    Merge {
        /// The younger world; its name goes.
        from: MapId,
        /// The older world.
        into: MapId,
        /// From the younger world's frame to the older one's.
        into_from: Sim3,
        /// Key frame of the older world, born before the younger one's root.
        parent: KeyFrameId,
    },
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

/// Lengths times `factor` about a place that stays.
pub(crate) fn scaling_about(centre: &Vec3, factor: f64) -> Sim3 {
    Sim3::new(So3::identity(), centre * (1.0 - factor), factor)
}
