//! Collision check: how far a body can go along an arc, and then along its path, before it touches something.

use super::motion::{Motion, moved};
use super::reference::ReferencePath;
use crate::costmap::DynamicLayer;
use crate::distance::DistanceField;
use cairn_geometry::{Se2, Vec2};

/// Surroundings of the body: walls and moving objects.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Distances to static obstacles.
    pub field: &'a DistanceField,
    /// Moving objects, if they are tracked.
    pub moving: Option<&'a DynamicLayer>,
    /// Radius of the body in metres.
    pub radius_m: f64,
}

/// Result of the collision check.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ahead {
    /// Metres that are free; the distance checked if nothing is in the way.
    pub free_m: f64,
    /// Whether something is in the way.
    pub blocked: bool,
    /// Whether the nearest obstacle in the way moves.
    pub by_moving: bool,
    /// Least distance from the rim of the body to a wall along the part checked, in metres; below 0 where it would
    /// touch.
    pub clearance_m: f64,
}

impl Surroundings<'_> {
    /// Distance in metres from the rim of the body, standing at a point, to the nearest wall. Measured between cell
    /// centres, as in planning; below 0 inside the inflated obstacle and outside the map.
    pub fn wall_clearance_m(&self, point: Vec2) -> f64 {
        let distance = self.field.frame().cell_at(point).and_then(|c| self.field.distance_m(c));
        distance.unwrap_or(0.0) - self.radius_m
    }

    /// Checks the arc of a motion for `arc_m` metres, then the path from `along_m` on, up to `reach_m` in all.
    ///
    /// Moving objects are checked where they will be when the body gets there. Within one cell of the body, walls count
    /// only if they come nearer: a body that stands slightly too near to a wall must be able to leave.
    pub fn ahead(
        &self,
        world_from_body: &Se2,
        motion: Motion,
        arc_m: f64,
        path: Option<(&ReferencePath, f64)>,
        reach_m: f64,
    ) -> Ahead {
        let step_m = 0.5 * self.field.frame().resolution_m();
        let speed = motion.linear.abs().max(0.1);
        let here = self.wall_clearance_m(world_from_body.translation);
        let allowed = here.min(0.0) - 1e-9;
        let mut seen =
            Ahead { free_m: reach_m.max(0.0), blocked: false, by_moving: false, clearance_m: here };
        let (mut gone_m, mut pose) = (0.0, *world_from_body);
        while gone_m < reach_m {
            gone_m += step_m;
            let point = if gone_m <= arc_m {
                pose = moved(&pose, motion, step_m / speed);
                pose.translation
            } else {
                let Some((path, along_m)) = path else { break };
                path.at(along_m + gone_m - arc_m.max(0.0)).0
            };
            let wall = self.wall_clearance_m(point);
            seen.clearance_m = seen.clearance_m.min(wall);
            let near = self.moving.map_or(f64::INFINITY, |m| m.clearance_m(point, (gone_m / speed).min(3.0)));
            if wall < allowed || near < self.radius_m {
                let free_m = (gone_m - step_m).max(0.0);
                return Ahead { free_m, blocked: true, by_moving: wall >= allowed, ..seen };
            }
        }
        seen
    }
}
