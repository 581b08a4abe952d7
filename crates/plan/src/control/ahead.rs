//! Collision check: how far a body can go along an arc, and then along its path, before it touches something.

use super::motion::{Twist, moved};
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
pub struct CollisionCheck {
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
    /// Moving objects are checked where they will be when the body gets there. Walls and moving objects that are too near
    /// already count only if they come nearer: a body that stands too near must be able to leave, and from a moving object
    /// that means away from where it is now.
    pub fn ahead(
        &self,
        world_from_body: &Se2,
        motion: Twist,
        arc_m: f64,
        path: Option<(&ReferencePath, f64)>,
        reach_m: f64,
    ) -> CollisionCheck {
        let step_m = 0.5 * self.field.frame().resolution_m();
        let speed = motion.linear.abs().max(0.1);
        let here = self.wall_clearance_m(world_from_body.translation);
        let allowed = here.min(0.0) - 1e-9;
        let moving_m =
            |at: Vec2, ahead_s: f64| self.moving.map_or(f64::INFINITY, |m| m.clearance_m(at, ahead_s));
        let moving_here = moving_m(world_from_body.translation, 0.0);
        let is_too_near = moving_here < self.radius_m;
        let mut seen =
            CollisionCheck { free_m: reach_m.max(0.0), blocked: false, by_moving: false, clearance_m: here };
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
            let comes_near = if is_too_near {
                moving_m(point, 0.0) < moving_here - 1e-9
            } else {
                moving_m(point, (gone_m / speed).min(3.0)) < self.radius_m
            };
            if wall < allowed || comes_near {
                let free_m = (gone_m - step_m).max(0.0);
                return CollisionCheck { free_m, blocked: true, by_moving: wall >= allowed, ..seen };
            }
        }
        seen
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::costmap::{Detection, DynamicConfig};
    use crate::grid::{Grid, GridFrame};

    #[test]
    fn a_body_too_near_to_someone_may_leave_and_not_come_nearer() {
        let frame = GridFrame::new(120, 120, 0.05, Se2::identity()).unwrap();
        let field = DistanceField::new(&Grid::filled(frame, false));
        let mut moving = DynamicLayer::new(DynamicConfig::default());
        let someone = Detection { position: Vec2::new(3.5, 3.0), radius_m: 0.25 };
        (0..20).for_each(|k| assert!(!moving.observe(0.1 * f64::from(k), &[someone]).out_of_order));
        let around = Surroundings { field: &field, moving: Some(&moving), radius_m: 0.2 };
        let at = |angle: f64| Se2::from_xy_angle(3.0, 3.0, angle);
        assert!(moving.clearance_m(at(0.0).translation, 0.0) < 0.2, "too near");
        let go = Twist::new(0.3, 0.0);
        let blocked = |angle: f64| around.ahead(&at(angle), go, 1.0, None, 1.0).blocked;
        assert!(blocked(0.0) && blocked(0.5), "towards him");
        assert!(!blocked(std::f64::consts::PI) && !blocked(2.0), "away");
        let back = around.ahead(&at(0.0), Twist::new(-0.3, 0.0), 0.5, None, 0.5);
        assert!(!back.blocked, "backwards");
        // From farther away he is kept clear of as ever.
        let far = around.ahead(&Se2::from_xy_angle(2.0, 3.0, 0.0), go, 2.0, None, 2.0);
        assert!(far.blocked && far.by_moving && far.free_m < 1.0, "{far:?}");
    }
}
