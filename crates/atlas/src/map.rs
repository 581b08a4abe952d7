//! Worlds: pieces of the map that have a frame of their own.
//!
//! When tracking is lost and the place is not recognised, mapping begins anew in another world of the same map. When a
//! place is recognised later, the worlds are merged. Nothing is shown or observed from one world to another.

use crate::KeyFrameId;
use cairn_geometry::Se3;

/// A world, named after its eldest key frame, its root.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapId(pub KeyFrameId);

impl MapId {
    /// The eldest key frame: it is where the world is, it never moves by adjustment and is never culled.
    pub fn root(self) -> KeyFrameId {
        self.0
    }
}

/// How a world hangs on a former one as long as the place where they meet is not known: the last pose that was known
/// there, carried on to the root of the new world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPrior {
    /// Key frame of the former world.
    pub to: KeyFrameId,
    /// Where the root was believed to stand in the eye frame of `to`, in the units of `to` (see [`crate::KeyFrame::unit`]).
    pub to_from_root: Se3,
    /// Standard deviation of that place, in the former world's unit of length.
    pub sigma: f64,
    /// Standard deviation of that direction, radians.
    pub sigma_rad: f64,
    /// Standard deviation of the natural logarithm of the scale between the two maps: 0 where both are metric, about 0.15
    /// where the walking pace says how long the younger map's unit is.
    pub sigma_log_scale: f64,
}
