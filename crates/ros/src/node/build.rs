//! What a node is made of: SLAM by its options, the tree of frames, the grid, the clock.

use super::NodeError;
use crate::assemble::Clock;
use crate::faults::{Faults, Severity};
use crate::frames::FrameTree;
use crate::grid::GroundGrid;
use crate::options::{Options, Topics};
use crate::setup::Found;
use crate::time::Time;
use cairn::geometry::Se3;
use cairn::sensor::{ClockReading, Live};
use cairn::{Config, Slam};
use std::path::Path;

/// SLAM for a rig, in a saved map where one is given.
pub(super) fn build(
    options: &Options,
    topics: &Topics,
    found: &Found,
    config: &Config,
    map: Option<&Path>,
) -> Result<Slam, NodeError> {
    let mut builder = Slam::builder(&found.rig).sensor(topics.mode()).config(config).threaded();
    if let Some(path) = map {
        let file = Slam::load_map(path)?;
        builder = if options.localize_only { builder.localize_in(file) } else { builder.map(file) };
    }
    Ok(builder.build()?)
}

/// The tree of frames of a rig at its place on the robot.
pub(super) fn tree(options: &Options, slam: &Slam, found: &Found) -> FrameTree {
    let body_from_cam0 = found.rig.cameras.first().map_or_else(Se3::identity, |c| c.body_from_camera);
    let body_from_rectified = slam.engine().front_end().model().body_from_camera;
    let base_from_rectified = found.base_from_camera * body_from_cam0.inverse() * body_from_rectified;
    let tree = FrameTree::new(base_from_rectified, found.up);
    if options.planar { tree.on_a_plane() } else { tree }
}

/// The time in the packets' clock: the age of a picture is what has passed since its stamp.
pub(super) struct HostClock(pub(super) Clock, pub(super) Time);

impl Live for HostClock {
    fn clock(&self) -> Option<ClockReading> {
        Some(ClockReading { now: self.0.of_packets(self.1.now()?), bound_s: 0.0, delivery_s: 0.0 })
    }
}

/// The grid of a rig with depth; what speaks against it is said.
pub(super) fn ground_grid(
    options: &Options,
    found: &Found,
    stood_m: f64,
    faults: &Faults,
) -> Option<GroundGrid> {
    let depth = found.rig.depth.as_ref()?;
    let body_from_cam0 = found.rig.cameras.first()?.body_from_camera;
    let base_from_depth = found.base_from_camera * body_from_cam0.inverse() * depth.body_from_depth;
    let made = GroundGrid::new(depth, base_from_depth, options.grid_range_m, stood_m);
    made.inspect_err(|why| faults.say(Severity::Warn, &why.to_string())).ok()
}
