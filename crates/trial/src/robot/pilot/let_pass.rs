//! Letting pass: where the robot goes out of the way of whoever it met, and how long it stays there.
//!
//! In: what moves and what has newly come to stand. Out: the place beside the way, and when the way is clear.

use super::{Decision, Pilot, Then, TrialError};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::Twist;
use cairn_plan::costmap::DynamicLayer;
use cairn_plan::give_way::{GiveWayConfig, place_beside};
use cairn_plan::search::WeightedAStar;

/// What moves or newly stands within this distance of the robot may be what is in its way, metres.
const IN_THE_WAY_M: f64 = 2.5;
/// It goes so far beside the line on which it met him, metres: people stop for what is nearer, and a small room has no more.
const BESIDE_M: f64 = 0.9;
/// Whoever was met has left when nothing moves within this distance of that place, or of the robot, metres.
const LEFT_M: f64 = 1.5;
/// He is gone when he has been away from there for this time, seconds.
const LEFT_S: f64 = 1.0;
/// The robot lets pass for at most this time, seconds,
const LETS_PASS_S: f64 = 8.0;
/// and for this time where someone is on its way, or went out of sight on it: behind him it would drive into a dead end.
const WAY_TAKEN_S: f64 = 30.0;
/// Whoever is this near to the way to the goal is on it, metres.
const ON_WAY_M: f64 = 0.8;
/// The place is watched when it is within this angle of the middle of the image, radians.
const WATCHES: f64 = 0.5;
/// The robot turns to watch at most at this rate, rad/s.
const WATCH_RATE: f64 = 1.0;

/// A place to let someone pass, and where he was met.
#[derive(Clone, Copy, Debug)]
pub(super) struct PassingPlace {
    pub at: Vec2,
    pub met: Vec2,
}

impl Pilot {
    /// Forgets what has newly come to stand: it may have gone since it was seen. Where something moves or stands near by, the robot
    /// lets it pass, as far as there is a place; returns that place, and whether anything was forgotten.
    pub(super) fn let_pass(&mut self, pose: &Se2) -> Result<(Option<PassingPlace>, bool), TrialError> {
        let other = self.ground.nearest_new(pose.translation);
        let forgotten = self.ground.forget_new()?;
        let near = other.filter(|at| (at - pose.translation).norm() < IN_THE_WAY_M);
        let place = near.and_then(|other| {
            let (passable, from) = (self.ground.costs()?.passable(), self.own_cell(pose)?);
            let config = GiveWayConfig { beside_m: BESIDE_M, ..GiveWayConfig::default() };
            let at = place_beside(&passable, from, other, &self.trails, &config)?;
            Some(PassingPlace { at, met: other })
        });
        Ok((place, forgotten))
    }

    /// Stands aside and watches the place where someone was met, until he has left it and the way.
    pub(super) fn stand_aside(
        &mut self,
        t_s: f64,
        pose: &Se2,
        motion: Twist,
        (met, from_s, clear_from_s, then): (Vec2, f64, Option<f64>, Then),
    ) -> Decision {
        let seen = pose.inverse() * met;
        let bearing = seen.y.atan2(seen.x);
        let is_taken = self.is_way_taken(pose, &then);
        let is_clear =
            !is_taken && bearing.abs() < WATCHES && is_left(self.ground.moving(), met, pose.translation);
        let clear_from_s = clear_from_s.filter(|_| is_clear).or(is_clear.then_some(t_s));
        let most_s = if is_taken { WAY_TAKEN_S } else { LETS_PASS_S };
        if clear_from_s.is_some_and(|since_s| t_s - since_s > LEFT_S) || t_s - from_s > most_s {
            self.go_on(then);
        } else {
            self.task = super::Task::LetPass { met, from_s, clear_from_s, then };
        }
        self.turn(motion, (1.5 * bearing).clamp(-WATCH_RATE, WATCH_RATE))
    }

    /// Whether someone is on the way to the goal that comes next, or went out of sight on it.
    fn is_way_taken(&self, pose: &Se2, then: &Then) -> bool {
        let Then::Visit { goal, .. } = then else { return false };
        let way = || {
            let (costs, from) = (self.ground.costs()?, self.own_cell(pose)?);
            let to = costs.frame().cell_at(self.free_goal(self.goals[*goal]))?;
            Some(WeightedAStar::new().search(costs.costs(), from, to).ok()?.points(costs.frame()))
        };
        way().is_some_and(|way| self.last_seen.on_the_way(&way, ON_WAY_M).is_some())
    }
}

/// Whether nothing moves near the place where someone was met, nor near the robot.
fn is_left(moving: &DynamicLayer, met: Vec2, robot: Vec2) -> bool {
    let is_near = |at: Vec2| (at - met).norm() < LEFT_M || (at - robot).norm() < LEFT_M;
    !moving.tracks().iter().any(|t| is_near(t.position))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_plan::costmap::{Detection, DynamicConfig};

    #[test]
    fn whoever_was_met_has_left_when_nobody_is_there_nor_near_the_robot() {
        let (met, robot) = (Vec2::new(5.0, 0.0), Vec2::zeros());
        let with = |at: Vec2| {
            let mut moving = DynamicLayer::new(DynamicConfig::default());
            moving.observe(0.0, &[Detection { position: at, radius_m: 0.25 }]);
            moving
        };
        assert!(!is_left(&with(met + Vec2::new(0.5, 0.5)), met, robot), "still there");
        assert!(!is_left(&with(Vec2::new(1.0, 0.5)), met, robot), "passes the robot");
        let mut gone = with(Vec2::new(5.0, 3.0));
        assert!(is_left(&gone, met, robot), "elsewhere");
        gone.observe(5.0, &[]);
        assert!(gone.tracks().is_empty() && is_left(&gone, met, robot), "out of sight");
    }
}
