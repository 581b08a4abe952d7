//! Drives to a goal: plans over the costmap, smooths, follows, recovers, and always gives a reason.
//!
//! States: `IDLE` (no goal), `PLANNING`, `EXECUTING`, `REACHED`, `NO_PATH`, `BLOCKED`. When something is in the way,
//! the navigator waits, longer for what moves. If it stays there, the body turns towards the direction of the path, then
//! backs up as far as the ground behind is free, then plans again around moving objects. A way around is taken once the
//! body has waited for as long as it takes longer, so that waiting and driving together are never more than twice the
//! better of the two (the rule of renting or buying skis; Karlin, Manasse, Rudolph and Sleator 1988). A change of the map
//! on the path, a jump of the pose (a loop closure) and a body off its path all trigger a new plan; a pose that is not
//! finite stops the body, and so does a motion that is not.

use super::ahead::Surroundings;
use super::config::NavigatorConfig;
use super::motion::Twist;
use super::mppi::Mppi;
use super::path_finder::PathFinder;
use super::pursuit::{Following, Pursuit};
use super::reference::ReferencePath;
use super::step::{Reason, State, Step};
use crate::costmap::{Costmap, DynamicLayer};
use crate::search::{NoPath, Place};
use cairn_geometry::{Se2, Vec2};

/// Recoveries, in the order in which they are tried.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Recovery {
    Wait,
    Turn,
    BackUp { from: Vec2 },
}

/// Plans and follows; one goal at a time.
pub struct Navigator {
    config: NavigatorConfig,
    state: State,
    goal: Option<Vec2>,
    path: Option<ReferencePath>,
    pursuit: Pursuit,
    predictive: Option<Mppi>,
    finder: PathFinder,
    last_pose: Option<Se2>,
    recovery: Recovery,
    since_s: f64,
    attempts: u32,
    /// Since when (seconds) and where something has been in the way without the body getting on.
    blocked: Option<(f64, Vec2)>,
    /// Whether what is in the way moves.
    by_moving: bool,
    /// Whether the next plan goes around moving objects.
    around: bool,
    why: Reason,
}

impl Navigator {
    /// Without a goal.
    pub fn new(config: NavigatorConfig) -> Self {
        Self {
            config,
            state: State::Idle,
            goal: None,
            path: None,
            pursuit: Pursuit::new(config.pursuit),
            predictive: config.predictive.map(Mppi::new),
            finder: PathFinder::new(),
            last_pose: None,
            recovery: Recovery::Wait,
            since_s: 0.0,
            attempts: 0,
            blocked: None,
            by_moving: false,
            around: false,
            why: Reason::NewGoal,
        }
    }

    /// Sets a goal (metres, world), valid from the next step on.
    pub fn set_goal(&mut self, goal: Vec2) {
        (self.goal, self.attempts, self.around, self.blocked) = (Some(goal), 0, false, None);
        self.plan_again(Reason::NewGoal);
    }

    /// Drops the goal.
    pub fn cancel(&mut self) {
        (self.goal, self.path, self.state) = (None, None, State::Idle);
    }

    /// The configuration.
    pub fn config(&self) -> &NavigatorConfig {
        &self.config
    }

    /// The current state.
    pub fn state(&self) -> State {
        self.state
    }

    /// The path being followed.
    pub fn path(&self) -> Option<&ReferencePath> {
        self.path.as_ref()
    }

    /// One step, to be called once per period: the command for this time (seconds), pose, motion and surroundings. Paths
    /// are planned on `costs`, and so is the collision check.
    pub fn step(
        &mut self,
        time_s: f64,
        world_from_body: &Se2,
        motion: Twist,
        costs: &Costmap,
        moving: Option<&DynamicLayer>,
    ) -> Step {
        self.step_locally(time_s, world_from_body, motion, costs, costs, moving)
    }

    /// As [`Navigator::step`], with a second costmap of the ground around the body for the collision check: a window that
    /// moves with it and holds what the sensors see now. It reaches farther than the body looks ahead.
    pub fn step_locally(
        &mut self,
        time_s: f64,
        world_from_body: &Se2,
        motion: Twist,
        costs: &Costmap,
        local: &Costmap,
        moving: Option<&DynamicLayer>,
    ) -> Step {
        let (t, r) = (world_from_body.translation, world_from_body.rotation);
        if ![t.x, t.y, r.cos(), r.sin()].iter().all(|v| v.is_finite()) {
            self.last_pose = None;
            return self.stand(motion, Some(Reason::PoseInvalid));
        }
        if !(motion.linear.is_finite() && motion.angular.is_finite()) {
            return self.stand(motion, Some(Reason::MotionInvalid));
        }
        let limits = [Some(self.config.pursuit.limits), self.config.predictive.map(|p| p.limits)];
        if let Some(why) = limits.iter().flatten().find_map(|limits| limits.check().err()) {
            return self.stand(motion, Some(Reason::LimitsInvalid(why)));
        }
        let gone = self.last_pose.map_or(0.0, |last| (t - last.translation).norm());
        self.last_pose = Some(*world_from_body);
        let expected = motion.linear.abs() * 2.0 * self.config.pursuit.period_s;
        if gone > expected + self.config.jump_m && matches!(self.state, State::Executing | State::Blocked) {
            self.plan_again(Reason::PoseJumped(gone));
        }
        match self.state {
            State::Idle | State::Reached | State::NoPath => self.stand(motion, None),
            State::Planning => self.plan(time_s, world_from_body, motion, costs, moving),
            State::Executing | State::Blocked => {
                let radius_m = costs.config().touch_m(costs.frame().resolution_m());
                let [around, everywhere] =
                    [local, costs].map(|map| Surroundings { field: map.field(), moving, radius_m });
                self.follow(time_s, world_from_body, motion, &around, &everywhere)
            }
        }
    }

    /// Slows down to a stop; at once from a motion that is not known.
    fn stand(&mut self, motion: Twist, reason: Option<Reason>) -> Step {
        let is_known = motion.linear.is_finite() && motion.angular.is_finite();
        let motion = if is_known { motion } else { Twist::stop() };
        let p = &self.config.pursuit;
        let motion = p.limits.reachable(motion, Twist::stop(), p.period_s);
        self.commanded(motion);
        Step { state: self.state, motion, reason, following: None }
    }

    /// Informs both followers of a command that neither of them gave.
    fn commanded(&mut self, motion: Twist) {
        self.pursuit.commanded(motion);
        self.predictive.iter_mut().for_each(|p| p.commanded(motion));
    }

    /// One step of the active follower; the other is informed of the command.
    fn follower_step(
        &mut self,
        pose: &Se2,
        motion: Twist,
        path: &ReferencePath,
        around: &Surroundings,
    ) -> Following {
        match &mut self.predictive {
            Some(predictive) if !self.pursuit.is_needed(pose, path) => {
                let following = predictive.step(pose, motion, path, around);
                self.pursuit.commanded(following.motion);
                self.pursuit.restart(following.projection.along_m);
                following
            }
            other => {
                let following = self.pursuit.step(pose, motion, path, around);
                if let Some(predictive) = other {
                    predictive.commanded(following.motion);
                    predictive.restart(following.projection.along_m);
                }
                following
            }
        }
    }

    fn plan_again(&mut self, why: Reason) {
        (self.state, self.path, self.why, self.recovery) = (State::Planning, None, why, Recovery::Wait);
    }

    fn plan(
        &mut self,
        time_s: f64,
        pose: &Se2,
        motion: Twist,
        costs: &Costmap,
        moving: Option<&DynamicLayer>,
    ) -> Step {
        let waited_s = self.blocked.map_or(0.0, |(since_s, _)| time_s - since_s);
        let around = moving.filter(|_| self.around).map(|moving| (moving, waited_s));
        let found = match self.goal {
            Some(goal) => self.finder.find(&self.config, pose, goal, costs, around),
            None => Err(NoPath::NotFinite(Place::Goal)),
        };
        let reason = match found {
            Ok(path) => {
                (self.path, self.around) = (Some(path), false);
                self.pursuit.restart(0.0);
                self.predictive.iter_mut().for_each(|p| p.restart(0.0));
                self.state = State::Executing;
                self.why
            }
            Err(reason) => {
                self.state = State::NoPath;
                Reason::NoPath(reason)
            }
        };
        let state = self.state;
        let step = self.stand(motion, Some(reason));
        Step { state: if state == State::NoPath { state } else { State::Planning }, ..step }
    }

    fn follow(
        &mut self,
        time_s: f64,
        pose: &Se2,
        motion: Twist,
        around: &Surroundings,
        everywhere: &Surroundings,
    ) -> Step {
        let Some(path) = self.path.take() else {
            self.plan_again(self.why);
            return self.stand(motion, Some(self.why));
        };
        let step = self.follow_path(time_s, pose, motion, [around, everywhere], &path);
        if self.state != State::Planning {
            self.path = Some(path);
        }
        step
    }

    fn follow_path(
        &mut self,
        time_s: f64,
        pose: &Se2,
        motion: Twist,
        [around, everywhere]: [&Surroundings; 2],
        path: &ReferencePath,
    ) -> Step {
        if let Some(step) = self.recover(time_s, pose, motion, around, path) {
            return step;
        }
        let following = self.follower_step(pose, motion, path, around);
        let along_m = following.projection.along_m;
        if following.projection.lateral_m.abs() > self.config.off_path_m {
            let why = Reason::OffPath(following.projection.lateral_m.abs());
            self.plan_again(why);
            return self.stand(motion, Some(why));
        }
        if let Some(blocked_m) = blocked_along(path, along_m, everywhere) {
            self.plan_again(Reason::MapChanged(blocked_m));
            return self.stand(motion, Some(self.why));
        }
        let mut reason = None;
        if following.reached {
            if motion.linear.abs() < 0.02 && motion.angular.abs() < 0.05 {
                self.state = State::Reached;
            }
        } else if following.blocked {
            let free_m = following.ahead.free_m;
            reason =
                Some(if following.ahead.by_moving { Reason::Moving(free_m) } else { Reason::Wall(free_m) });
            self.by_moving = following.ahead.by_moving;
            let (since_s, _) = *self.blocked.get_or_insert((time_s, pose.translation));
            if self.by_moving && time_s - since_s > self.config.patience_s {
                self.state = State::NoPath;
                return self.stand(motion, Some(Reason::GivenUp(self.attempts)));
            }
            if self.state != State::Blocked {
                (self.state, self.recovery, self.since_s) = (State::Blocked, Recovery::Wait, time_s);
            }
        } else {
            // Driving back over the ground on which it backed up is not getting on.
            let is_away = |(_, at): (f64, Vec2)| (pose.translation - at).norm() > self.config.back_up_m + 0.5;
            if self.blocked.is_some_and(is_away) {
                (self.attempts, self.blocked) = (0, None);
            }
            self.state = State::Executing;
        }
        Step { state: self.state, motion: following.motion, reason, following: Some(following) }
    }

    /// The recovery to try while something stays in the way; `None` while waiting.
    fn recover(
        &mut self,
        time_s: f64,
        pose: &Se2,
        motion: Twist,
        around: &Surroundings,
        path: &ReferencePath,
    ) -> Option<Step> {
        if self.state != State::Blocked {
            return None;
        }
        let p = self.config.pursuit;
        let is_waiting = self.recovery == Recovery::Wait;
        let wait_s = if is_waiting && self.by_moving { self.config.passing_s } else { self.config.wait_s };
        let late = time_s - self.since_s > wait_s;
        let order = |wish: Twist, reason: Reason, me: &mut Self| {
            let motion = p.limits.reachable(motion, wish, p.period_s);
            me.commanded(motion);
            Some(Step { state: State::Blocked, motion, reason: Some(reason), following: None })
        };
        match self.recovery {
            Recovery::Wait if !late => None,
            Recovery::Wait => {
                (self.recovery, self.since_s) = (Recovery::Turn, time_s);
                order(Twist::stop(), Reason::Turning, self)
            }
            Recovery::Turn => {
                let at = path.project(pose.translation, 0.0, path.length_m()).along_m;
                let seen = pose.inverse() * path.at(at + p.look_ahead_m.1).0;
                let bearing = seen.y.atan2(seen.x);
                if bearing.abs() < 0.2 || late {
                    (self.recovery, self.since_s) = (Recovery::BackUp { from: pose.translation }, time_s);
                    return order(Twist::stop(), Reason::BackingUp, self);
                }
                order(Twist::new(0.0, 0.5 * p.limits.angular * bearing.signum()), Reason::Turning, self)
            }
            Recovery::BackUp { from } => {
                let gone = (pose.translation - from).norm();
                let behind =
                    around.ahead(pose, Twist::new(-1.0, 0.0), f64::INFINITY, None, p.stop_distance_m + 0.1);
                if gone < self.config.back_up_m && !behind.blocked && time_s - self.since_s < 5.0 {
                    return order(Twist::new(-p.limits.backwards, 0.0), Reason::BackingUp, self);
                }
                self.attempts += 1;
                if self.attempts > self.config.attempts {
                    self.state = State::NoPath;
                    return Some(self.stand(motion, Some(Reason::GivenUp(self.attempts - 1))));
                }
                self.around = true;
                self.plan_again(Reason::PlanningAround);
                Some(self.stand(motion, Some(Reason::PlanningAround)))
            }
        }
    }
}

/// Distance in metres along the path to where a wall blocks it. A way out of ground that is too near to a wall does not count.
fn blocked_along(path: &ReferencePath, along_m: f64, around: &Surroundings) -> Option<f64> {
    let step_m = around.field.frame().resolution_m();
    // The end of the path and the first cell ahead of the body are left to the follower.
    let steps = ((path.length_m() - along_m) / step_m) as usize;
    let limit = -0.5 * step_m;
    let at = |k: usize| around.wall_clearance_m(path.at(along_m + step_m * k as f64).0);
    let here = at(0) - 1e-9;
    let out = (0..steps).find(|&k| at(k) >= limit || at(k) < here).unwrap_or(steps);
    (out.max(5)..steps).step_by(2).find(|&k| at(k) < limit).map(|k| step_m * k as f64)
}
