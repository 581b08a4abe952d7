//! Changes to a snapshot, as data.

use crate::{ImuFactor, KeyFrame, KeyFrameId, LandmarkId, MapId, MapPrior, Readout, RelativePose};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_inertial::Bias;

/// One change.
#[derive(Clone, Debug)]
pub enum Change {
    /// Adds a key frame, without observations; one without a parent is the root of a new map.
    AddKeyFrame(Box<KeyFrame>),
    /// Adds a landmark at a position in the world frame; its observations follow.
    AddLandmark(LandmarkId, Vec3),
    /// Sets the pose of a key frame: `world_from_camera`.
    MoveKeyFrame(KeyFrameId, Se3),
    /// Multiplies the unit of a key frame in its map by this factor.
    Scale(KeyFrameId, f64),
    /// Sets velocity (along the camera's axes, m/s) and biases of a key frame that has an inertial state.
    InertialState(KeyFrameId, Vec3, Bias),
    /// Sets the IMU factor of a key frame that has an inertial state; `None` removes it.
    ImuFactor(KeyFrameId, Option<ImuFactor>),
    /// Sets the time offset: seconds to be added to the stamps of the IMU, beyond what its source adds, to
    /// get the images' clock.
    ImuOffset(f64),
    /// Sets the readout time of the camera's rows.
    Readout(Readout),
    /// Sets where the atlas's camera is on its IMU (the lever arm), metres; it keeps its rotation.
    LeverArm(Vec3),
    /// Gravity and scale of a map are known, or known better: everything in it is transformed by this, and
    /// from now on its lengths are metres and its z axis points up.
    AlignGravity(MapId, Sim3),
    /// Lengths in a map are multiplied by this about its root: its unit of length is better known than it was.
    /// The map does not become metric by it.
    Rescale(MapId, f64),
    /// States how well the unit of length of a map is known: the standard deviation of the natural logarithm of metres in a unit.
    ScaleSigma(MapId, f64),
    /// Sets the position of a landmark.
    MoveLandmark(LandmarkId, Vec3),
    /// Adds an observation: a feature of a key frame shows this landmark (and no other).
    Observe(LandmarkId, KeyFrameId, u16),
    /// Removes the observation of a landmark in a key frame.
    Forget(LandmarkId, KeyFrameId),
    /// The first landmark is the same point as the second: its observations are moved over, and it is
    /// removed.
    Fuse(LandmarkId, LandmarkId),
    /// Sets the disparity correction: pixels to be added to every measured right x.
    Calibrate(f64),
    /// Removes a landmark.
    RemoveLandmark(LandmarkId),
    /// Connects two key frames by a loop closure.
    Link(KeyFrameId, KeyFrameId),
    /// Sets the poses of a key frame relative to earlier ones, in the order of these, as depth measured them, in place of those that it had.
    /// Those relative to key frames that are no more are left out.
    RelativePoses(KeyFrameId, Vec<RelativePose>),
    /// Sets the pose of a map relative to an earlier one, until they are merged.
    MapPrior(MapId, MapPrior),
    /// Merges a younger map into an older one: everything in it is transformed by `into_from`, and its root
    /// becomes a child of `parent`, which is older than it.
    Merge {
        /// The younger map; its id is retired.
        from: MapId,
        /// The older map.
        into: MapId,
        /// From the younger map's frame to the older one's.
        into_from: Sim3,
        /// Key frame of the older map, created before the younger one's root.
        parent: KeyFrameId,
    },
    /// Removes a key frame; what is anchored to it is anchored to its parent from now on.
    RemoveKeyFrame(KeyFrameId),
}

/// Changes made on one snapshot.
#[derive(Clone, Debug, Default)]
pub struct ChangeSet {
    /// The version they were made on.
    pub base: u64,
    /// The changes, in order.
    pub changes: Vec<Change>,
}

/// The result of applying a change set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Applied {
    /// Changes applied.
    pub done: usize,
    /// Changes that were left out, because they name something that no longer exists or violate a rule of the
    /// map.
    pub dropped: usize,
}

/// Scaling by `factor` about a point that stays.
pub(crate) fn scaling_about(centre: &Vec3, factor: f64) -> Sim3 {
    Sim3::new(So3::identity(), centre * (1.0 - factor), factor)
}
