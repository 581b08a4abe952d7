//! Goals, and the path to the one at hand.

use super::Node;
use crate::faults::Severity;
use crate::grid::GroundGrid;
use crate::messages::PoseStamped;
use crate::planner::Planned;
use crate::results;
use cairn::geometry::Se3;

impl Node<'_> {
    /// Takes a goal, and plans to it at once.
    pub(super) fn take_goal(&mut self, goal: &PoseStamped) {
        let frame = goal.header.frame_id.as_str();
        let refused = match (self.map_from(frame).zip(goal.pose.se3()), &self.grid) {
            (_, None) => "a goal needs the occupancy grid, and that a depth camera".to_owned(),
            (None, _) => format!("a goal in the frame \"{frame}\" is not known, or its pose is none"),
            (Some((map_from_frame, pose)), Some(_)) => {
                self.shown.no_path.clear();
                self.planner.set_goal(Some(map_from_frame * pose));
                self.plan();
                return;
            }
        };
        self.faults.say(Severity::Warn, &refused);
    }

    /// Where a frame is in the map as it is published; `None` for an unknown one, and while the place in the map is not known.
    pub(super) fn map_from(&self, frame: &str) -> Option<Se3> {
        let map_from_base = self.tree.map_from_base().map(|pose| self.tree.published(pose));
        match frame.trim_start_matches('/') {
            frame if frame == self.names.map => Some(Se3::identity()),
            frame if frame == self.names.base => map_from_base,
            frame if frame == self.names.odom => Some(map_from_base? * self.tree.odom_from_base().inverse()),
            _ => None,
        }
    }

    /// Publishes the path to the goal, where there is one.
    pub(super) fn plan(&mut self) {
        let Some((last, _)) = self.last else { return };
        let Some(map_from_base) = self.tree.map_from_base() else { return };
        let Some(map) = self.grid.as_ref().and_then(GroundGrid::map) else { return };
        let (path, line) = match self.planner.step(map, &map_from_base) {
            None => return,
            Some(Planned::Path(path)) => (path, String::new()),
            Some(Planned::Reached) => (Vec::new(), "the goal is reached".to_owned()),
            Some(Planned::NoPath(why)) => (Vec::new(), format!("no path to the goal: {why}")),
        };
        if !line.is_empty() && line != self.shown.no_path {
            self.faults.say(Severity::Info, &line);
        }
        self.shown.no_path = line;
        self.network.plan.publish(results::plan(self.clock.of_messages(last), &self.names, &path));
    }
}
