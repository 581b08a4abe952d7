//! Where the walker is.

use cairn_engine::{FramePose, Output};
use cairn_geometry::{Camera, Odom, Pose, Se3, Similarity, World};
use cairn_guide::{Anchor, RecordInput};
use cairn_sensor::Stamp;

/// A pose, in the odometry frame and in the map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub stamp: Stamp,
    /// In the map's frame and unit.
    pub world_from_camera: Pose<World, Camera>,
    /// In the frame and unit of the odometry.
    pub odom_from_camera: Pose<Odom, Camera>,
    pub world_from_odom: Similarity<World, Odom>,
    /// The segment of odometry it belongs to.
    pub segment: u32,
    /// The key frame it is anchored to, and the camera's pose in it.
    pub anchor: Anchor,
    pub anchor_from_camera: Se3,
}

impl Place {
    /// The poses of a frame that has one.
    pub fn of(output: &Output, seen: &RecordInput) -> Option<Self> {
        let FramePose { anchored, odometry, .. } = output.pose?;
        Some(Self {
            stamp: seen.stamp,
            world_from_camera: Pose::new(anchored.world_from_camera),
            odom_from_camera: seen.odom_from_camera,
            world_from_odom: odometry.world_from_odom,
            segment: odometry.segment,
            anchor: seen.anchor,
            anchor_from_camera: seen.anchor_from_camera,
        })
    }
}
