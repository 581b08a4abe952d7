//! The maps of an atlas: each has a frame of its own.
//!
//! When tracking is lost and the place is not recognised, mapping starts a new map in the same atlas. When a
//! place is recognised later, the maps are merged. No landmark is observed from two maps.

use crate::KeyFrameId;
use cairn_geometry::Se3;

/// A map, identified by its oldest key frame, its root.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapId(pub KeyFrameId);

impl MapId {
    /// The oldest key frame: it fixes the map's frame, is never moved by adjustment and never culled.
    pub fn root(self) -> KeyFrameId {
        self.0
    }
}

/// The pose of a map relative to an earlier one, as long as no common place has been recognised: the last
/// known pose there, propagated to the root of the new map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapPrior {
    /// Key frame of the earlier map.
    pub to: KeyFrameId,
    /// Estimated pose of the root in the camera frame of `to`, in the units of `to` (see
    /// [`crate::KeyFrame::unit`]).
    pub to_from_root: Se3,
    /// Standard deviation of that position, in the earlier map's unit of length.
    pub sigma: f64,
    /// Standard deviation of that orientation, radians.
    pub sigma_rad: f64,
    /// Standard deviation of the natural logarithm of the scale between the two maps: 0 where both are metric, about 0.15
    /// where the walking pace says how long the younger map's unit is.
    pub sigma_log_scale: f64,
}
