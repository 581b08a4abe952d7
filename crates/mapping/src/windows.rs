//! The windows of whole maps, with the factors that count in them.

use cairn_adjust::{Imu, Level, MotionLinks, RelativePoseFactors, Window, WindowBuilder};
use cairn_atlas::MapId;

/// With the readings of an IMU; `None` where the map has none.
pub(crate) fn inertial_whole(of: WindowBuilder, imu: Imu, map: MapId) -> Option<Window> {
    of.need(imu).add(Level::default()).add(RelativePoseFactors::default()).whole(map)
}

/// With the motions that other sensors measured.
pub(crate) fn whole(of: WindowBuilder, links: &MotionLinks, map: MapId) -> Option<Window> {
    of.add(links.factors()).add(RelativePoseFactors::default()).whole(map)
}
