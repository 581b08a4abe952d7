//! Exploring: the frontier with the shortest drive next, until none is left that can be reached or the time is over.
//!
//! In: the map of the ground. Out: the frontier to drive to, and what to do where someone is in the way to all of them.

use super::{Decision, Pilot, SAME_M, Task, Then, TrialError};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{State, Twist};
use cairn_plan::frontier::{Approach, Frontier, approaches, frontiers};

/// The target frontier is checked again after this time, seconds.
const CHECK_S: f64 = 0.5;
/// Frontiers that were given up are tried again so often before exploration ends.
const ROUNDS: usize = 1;
/// Someone is let pass, or what blocks the way looked at, so often before the frontiers behind are given up.
const UNBLOCK: usize = 3;
/// Of the frontiers to which no way leads so many are looked for.
const BLOCKED: usize = 3;

impl Pilot {
    pub(super) fn explore(&mut self, t_s: f64, pose: &Se2, motion: Twist) -> Result<Decision, TrialError> {
        if t_s > self.config.explore_s {
            return Ok(self.visit_next(t_s, motion));
        }
        if let Some(target) = self.target.clone() {
            let middle = target.frontier.middle;
            let decision = self.navigate(t_s, pose, motion);
            match decision.state {
                State::Reached => {
                    (self.target, self.task, self.unblocked) = (None, Task::Face(middle), 0);
                }
                State::NoPath => {
                    self.target = None;
                    if !self.unblock(pose)? {
                        self.given_up.push(middle);
                    }
                }
                _ if t_s - self.checked_s > CHECK_S => {
                    self.checked_s = t_s;
                    let same = |m: Vec2| (m - middle).norm() < SAME_M;
                    if !self.frontiers().iter().any(|f| same(f.middle)) {
                        self.target = None;
                    }
                }
                _ => {}
            }
            return Ok(decision);
        }
        let next = self.next_frontier(pose);
        let Some(next) = next else {
            if self.unblock(pose)? {
                return Ok(self.turn(motion, 0.0));
            }
            // What was given up may be reached now: someone stood in the door, the map was corrected.
            if self.rounds < ROUNDS && !self.given_up.is_empty() {
                self.rounds += 1;
                self.given_up.clear();
                self.task = Task::Look { turned: 0.0, then: Then::Explore };
                return Ok(self.turn(motion, 0.0));
            }
            return Ok(self.visit_next(t_s, motion));
        };
        self.navigator.set_goal(next.goal);
        self.targets.push((t_s, next.goal, next.frontier.cells.len()));
        (self.target, self.checked_s) = (Some(next), t_s);
        Ok(self.navigate(t_s, pose, motion))
    }

    /// Where frontiers are left but no way leads to them: lets pass whoever is in the way, or looks at what blocks the way. False when
    /// that was done a few times in vain, or there is nothing to look at.
    fn unblock(&mut self, pose: &Se2) -> Result<bool, TrialError> {
        let away = |at: &Vec2| (at - pose.translation).norm();
        let mut left: Vec<Vec2> = self.frontiers().iter().map(|f| f.middle).collect();
        left.retain(|at| self.is_open(*at));
        left.sort_by(|a, b| away(a).total_cmp(&away(b)));
        if self.unblocked >= UNBLOCK || left.is_empty() {
            return Ok(false);
        }
        let (place, forgotten) = self.let_pass(pose)?;
        let place = match place {
            None if !forgotten => left.iter().take(BLOCKED).find_map(|at| self.before_blockage(pose, *at)),
            place => place.map(|beside| beside.at),
        };
        match place {
            Some(at) => self.look_from(at, Then::Explore),
            None if forgotten || !self.is_looked_at(pose) => {
                self.task = Task::Look { turned: 0.0, then: Then::Explore };
            }
            None => return Ok(false),
        }
        self.unblocked += 1;
        Ok(true)
    }

    /// Whether a frontier was neither given up nor looked at in vain.
    fn is_open(&self, at: Vec2) -> bool {
        self.given_up.iter().chain(&self.faced).all(|g| (g - at).norm() > SAME_M)
    }

    fn frontiers(&self) -> Vec<Frontier> {
        self.ground.map().map_or_else(Vec::new, |map| frontiers(map, &self.config.frontier))
    }

    fn next_frontier(&self, pose: &Se2) -> Option<Approach> {
        let costs = self.ground.costs()?;
        let mut all = self.frontiers();
        all.retain(|f| self.is_open(f.middle));
        let passable = costs.passable();
        approaches(costs.map(), all, &passable, self.own_cell(pose)?, &self.config.frontier)
            .into_iter()
            .next()
    }
}
