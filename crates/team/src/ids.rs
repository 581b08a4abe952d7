//! Identifiers of robots and of their poses.

use serde::{Deserialize, Serialize};

/// A robot, phone or session of a team.
pub type RobotId = u16;

/// A pose of a robot. Ordered by robot, then by number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct PoseId {
    /// The robot that owns the pose.
    pub robot: RobotId,
    /// Its number among the poses of the robot; never reused.
    pub seq: u32,
}

/// The two ends of a loop between two robots, the smaller id first.
pub type LoopId = (PoseId, PoseId);
