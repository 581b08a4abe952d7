//! Visiting goals: driving there, and what to do where no known ground leads there.
//!
//! In: the goals and the map of the ground. Out: the next task, and how each goal ended.

use super::{Decision, GoalEnd, Pilot, SAME_M, Task, Then, TrialError, nearest_free};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{Reason, State, Twist};
use cairn_plan::frontier::{Frontier, FrontierConfig, approaches};
use std::f64::consts::PI;

/// A goal that cannot be reached is looked at from within this distance, metres.
const NEAR_GOAL_M: f64 = 1.5;
/// A blocked goal is moved by at most this, metres.
const GOAL_TOLERANCE_M: f64 = 0.2;
/// A robot that finds no path and has someone this near has met him, metres.
const MEETS_M: f64 = 1.3;
/// Blockages that are seen from one place, at most.
const BLOCKAGES: usize = 4;
/// Where nothing is left to try, the robot looks again from another place so often before NO_PATH is final.
const HELPLESS: usize = 3;

impl Pilot {
    /// A goal, or the free place nearest to it where it is blocked and there is one within the tolerance.
    pub(super) fn free_goal(&self, goal: Vec2) -> Vec2 {
        let near = || {
            let passable = self.ground.costs()?.passable();
            let frame = *passable.frame();
            let cell = frame.cell_at(goal).filter(|c| !passable.is_free(*c))?;
            let reach = (GOAL_TOLERANCE_M / frame.resolution_m()) as i32;
            Some(frame.centre(nearest_free(&passable, cell, reach)?))
        };
        near().filter(|at| (at - goal).norm() <= GOAL_TOLERANCE_M).unwrap_or(goal)
    }

    /// The place near a goal from which it can be looked at, if that is not here.
    fn near_goal(&self, pose: &Se2, goal: Vec2) -> Option<Vec2> {
        let (costs, from) = (self.ground.costs()?, self.own_cell(pose)?);
        let passable = costs.passable();
        let target = Frontier { cells: vec![costs.frame().cell_at(goal)?], middle: goal };
        let config = FrontierConfig { approach_m: NEAR_GOAL_M, ..self.config.frontier };
        let all = approaches(costs.map(), vec![target], &passable, from, &config);
        all.first().map(|a| a.goal).filter(|at| (at - pose.translation).norm() > SAME_M)
    }

    /// The place before what blocks or hides the way to the goal, if that is not here; what was looked at from here is left out.
    pub(super) fn before_blockage(&mut self, pose: &Se2, goal: Vec2) -> Option<Vec2> {
        let from = self.own_cell(pose)?;
        let goal = self.free_goal(goal);
        let costs = self.ground.costs()?;
        for _ in 0..BLOCKAGES {
            let blockage = self.once_open.blockage(costs, from, goal)?;
            if (blockage.before - pose.translation).norm() > SAME_M {
                return Some(blockage.before);
            }
            if !self.is_looked_at(pose) {
                return None;
            }
            self.once_open.search_failed(&blockage);
        }
        None
    }

    /// A free place about a metre away.
    fn aside(&mut self, pose: &Se2) -> Option<Vec2> {
        let (passable, from) = (self.ground.costs()?.passable(), self.own_cell(pose)?);
        let mut search = cairn_plan::search::AStar::new();
        (0..40).find_map(|_| {
            let (angle, by_m) = (self.random.uniform(-PI, PI), self.random.uniform(0.7, 1.5));
            let at = pose.translation + Vec2::new(angle.cos(), angle.sin()) * by_m;
            let to = passable.frame().cell_at(at).filter(|c| passable.is_free(*c))?;
            let path = search.search(&passable, from, to).ok()?;
            (path.length_m(passable.frame()) < 2.0 * by_m).then_some(at)
        })
    }

    pub(super) fn visit_next(&mut self, t_s: f64, motion: Twist) -> Decision {
        self.target = None;
        self.explored_s.get_or_insert(t_s);
        (self.helpless, self.looked_near, self.let_pass_at) = (0, false, None);
        self.once_open.retry();
        self.held_up = false;
        match self.errands.next() {
            Some(goal) => {
                self.navigator.set_goal(self.free_goal(self.goals[goal]));
                self.task = Task::Visit { goal, began_s: t_s };
            }
            None => {
                self.navigator.cancel();
                self.task = Task::Rest;
            }
        }
        self.turn(motion, 0.0)
    }

    pub(super) fn visit(
        &mut self,
        t_s: f64,
        pose: &Se2,
        motion: Twist,
        goal: usize,
        began_s: f64,
    ) -> Result<Decision, TrialError> {
        let decision = self.navigate(t_s, pose, motion);
        let late = t_s - began_s > self.config.goal_s;
        match decision.state {
            State::NoPath if !late => self.no_path(t_s, pose, goal, began_s)?,
            State::Reached | State::NoPath => self.end(t_s, goal, began_s, decision.state),
            state if late => self.end(t_s, goal, began_s, state),
            _ => {}
        }
        Ok(decision)
    }

    /// Whether the time for the goal that comes next is over.
    pub(super) fn is_late(&self, t_s: f64, then: &Then) -> Option<(usize, f64)> {
        match *then {
            Then::Visit { goal, began_s } if t_s - began_s > self.config.goal_s => Some((goal, began_s)),
            _ => None,
        }
    }

    /// No known ground leads to a goal, or someone stays in the way. While there is a way over ground that is unknown or was once
    /// open, the robot goes on: it looks at the goal from near by, then at what blocks the way, then at the next way, and at last lets
    /// pass whoever stands there.
    fn no_path(&mut self, t_s: f64, pose: &Se2, goal: usize, began_s: f64) -> Result<(), TrialError> {
        let (at, then) = (self.goals[goal], Then::Visit { goal, began_s });
        let here = |p: &Vec2| (p - pose.translation).norm() < MEETS_M;
        let met = self.ground.nearest_new(pose.translation).filter(here);
        // Who stands where the last one was let pass is perhaps a door.
        let known = met.is_some_and(|met| self.let_pass_at.is_some_and(|at| (at - met).norm() < SAME_M));
        let in_the_way = matches!(self.last_reason, Some(Reason::GivenUp(_))) || (met.is_some() && !known);
        self.let_pass_at = met.filter(|_| in_the_way);
        self.held_up |= in_the_way;
        if !in_the_way {
            let near = if self.looked_near { None } else { self.near_goal(pose, at) };
            self.looked_near = true;
            if let Some(place) = near.or_else(|| self.before_blockage(pose, at)) {
                self.look_from(place, then);
                return Ok(());
            }
            if !self.is_looked_at(pose) {
                self.task = Task::Look { turned: 0.0, then };
                return Ok(());
            }
        }
        let hope = self.once_open.retry();
        self.looked_near = false;
        let (place, forgotten) = self.let_pass(pose)?;
        if let Some(beside) = place {
            self.navigator.set_goal(beside.at);
            self.task = Task::Aside { met: Some(beside.met), then };
        } else if forgotten {
            self.navigator.set_goal(self.free_goal(at));
        } else if self.helpless < HELPLESS || hope {
            self.helpless += 1;
            match self.aside(pose) {
                Some(place) => self.look_from(place, then),
                None => self.task = Task::Look { turned: 0.0, then },
            }
        } else {
            self.end(t_s, goal, began_s, State::NoPath);
        }
        Ok(())
    }

    /// Whether the robot has looked around where it stands.
    pub(super) fn is_looked_at(&self, pose: &Se2) -> bool {
        self.looked_at.is_some_and(|at| (at - pose.translation).norm() < SAME_M)
    }

    /// Records how a try ended; the next one follows with the next step.
    pub(super) fn end(&mut self, t_s: f64, goal: usize, began_s: f64, state: State) {
        let reason = match state {
            State::Reached => None,
            _ => Some(self.last_reason.map_or("no reason".to_owned(), |r| r.to_string())),
        };
        let late = (t_s - began_s > self.config.goal_s).then(|| format!("after {:.0} s", t_s - began_s));
        let reason = match (reason, late) {
            (Some(reason), Some(late)) => Some(format!("{reason}, {late}")),
            (reason, _) => reason,
        };
        let end = GoalEnd { goal, state: state.to_string(), reason, seconds: t_s - began_s };
        self.errands.end(end, self.held_up);
        self.visit_next(t_s, Twist::stop());
    }
}
