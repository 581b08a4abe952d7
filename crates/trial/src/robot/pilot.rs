//! What the robot does: looks around, explores by frontiers, then visits its goals.
//!
//! In: where it is and what it sees. Out: the motion to command, the navigator's state and the reason for it.

use super::RobotConfig;
use super::localiser::{Localiser, Located};
use super::once_open::OnceOpen;
use super::{GoalEnd, TrialError};
use cairn_atlas::KeyFrameId;
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{Motion, Navigator, Reason, State};
use cairn_plan::depth_scan::{DepthCamera, DepthScanner};
use cairn_plan::frontier::{Approach, Frontier, FrontierConfig, approaches, frontiers};
use cairn_plan::ground::GroundMap;
use cairn_random::Random;
use cairn_sensor::FramePacket;
use std::f64::consts::{PI, TAU};

/// Rate at which the robot turns to look around, rad/s.
const LOOK_RATE: f64 = 1.0;
/// The target frontier is checked again after this time, seconds.
const CHECK_S: f64 = 0.5;
/// Two frontiers with middles this near to each other are the same, metres.
const SAME_M: f64 = 0.5;
/// The poses of all key frames are compared with the grid's after this time, seconds.
const POSES_S: f64 = 2.0;
/// In front of a plain wall the robot turns no faster than this, rad/s: from image to image enough must stay in view.
const PLAIN_RATE: f64 = 0.5;
/// A robot that is no longer sure of its place turns at this rate, rad/s: back to where it was, then on all around.
const FIND_RATE: f64 = 0.4;
/// A goal that cannot be reached is looked at from within this distance, metres.
const NEAR_GOAL_M: f64 = 1.5;
/// Frontiers that were given up are tried again so often before exploration ends.
const ROUNDS: usize = 1;
/// A blocked goal is moved by at most this, metres.
const GOAL_TOLERANCE_M: f64 = 0.2;
/// A goal is tried so often before NO_PATH is final; the robot looks around in between.
const TRIES: usize = 5;

/// What the robot is about.
#[derive(Clone, Debug)]
enum Task {
    /// Turning once around.
    Look { turned: f64, then: Then },
    /// Driving to frontiers.
    Explore,
    /// Turning towards a frontier that was reached and has not gone.
    Face(Vec2),
    /// Driving a little aside, to see from there what seemed to be in the way.
    Aside(Then),
    /// Driving to a goal.
    Visit { goal: usize, began_s: f64, tries: usize },
    /// All is done.
    Rest,
}

/// What follows a look around.
#[derive(Clone, Copy, Debug)]
enum Then {
    Explore,
    Visit { goal: usize, began_s: f64, tries: usize },
}

/// The command of a step, and why.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// The motion to command.
    pub motion: Motion,
    /// State of the navigator.
    pub state: State,
    /// The reason, where there is one.
    pub reason: Option<Reason>,
}

/// The robot's mind.
pub struct Pilot {
    config: RobotConfig,
    scanner: DepthScanner,
    ground: GroundMap<KeyFrameId>,
    once_open: OnceOpen,
    navigator: Navigator,
    task: Task,
    target: Option<Approach>,
    given_up: Vec<Vec2>,
    /// How often the frontiers that were given up have been tried again.
    rounds: usize,
    checked_s: f64,
    poses_s: f64,
    heading: Option<f64>,
    /// Where it looked when it was last sure of its place and saw enough, radians.
    seen_heading: Option<f64>,
    stood: bool,
    goals: Vec<Vec2>,
    /// How each goal ended.
    pub ends: Vec<GoalEnd>,
    /// When exploration ended, seconds.
    pub explored_s: Option<f64>,
    /// Changes of the navigator's state with their time and reason.
    pub states: Vec<(f64, State, Option<String>)>,
    /// Frontiers driven to: seconds, goal on the ground, cells.
    pub targets: Vec<(f64, Vec2, usize)>,
    /// How often a path was planned.
    pub plans: usize,
    /// How often the grid was laid again.
    pub laid_again: usize,
    last_reason: Option<Reason>,
    random: Random,
}

impl Pilot {
    /// With goals in the ground frame: that of the robot when it was switched on.
    ///
    /// # Errors
    /// When the camera cannot serve as a depth camera.
    pub fn new(config: &RobotConfig, goals: Vec<Vec2>) -> Result<Self, TrialError> {
        let camera = &config.sim.camera;
        let camera = DepthCamera {
            size: (camera.width, camera.height),
            focal: (camera.fx, camera.fy),
            centre: (camera.cx, camera.cy),
            metres_per_unit: 0.001,
            body_from_camera: config.sim.body_from_camera,
        };
        let scanner = DepthScanner::new(camera, config.scan)
            .ok_or(TrialError::Rig("its camera has no pixels or no finite pose".into()))?;
        let mut ground = config.ground;
        ground.occupancy.min_range_m = scanner.blind_m();
        Ok(Self {
            config: config.clone(),
            scanner,
            ground: GroundMap::new(ground),
            once_open: OnceOpen::default(),
            navigator: Navigator::new(config.navigator),
            task: Task::Look { turned: 0.0, then: Then::Explore },
            target: None,
            given_up: Vec::new(),
            rounds: 0,
            checked_s: 0.0,
            poses_s: 0.0,
            heading: None,
            seen_heading: None,
            stood: false,
            goals,
            ends: Vec::new(),
            explored_s: None,
            states: Vec::new(),
            targets: Vec::new(),
            plans: 0,
            laid_again: 0,
            last_reason: None,
            random: Random::new(config.seed),
        })
    }

    /// The ground as the robot knows it.
    pub fn ground(&self) -> &GroundMap<KeyFrameId> {
        &self.ground
    }

    /// The path being followed.
    pub fn path(&self) -> Option<&[Vec2]> {
        self.navigator.path().map(|p| p.points())
    }

    /// The goal being driven to, if exploration is over.
    pub fn goal(&self) -> Option<usize> {
        match self.task {
            Task::Visit { goal, .. }
            | Task::Aside(Then::Visit { goal, .. })
            | Task::Look { then: Then::Visit { goal, .. }, .. } => Some(goal),
            _ => None,
        }
    }

    /// Whether everything is done.
    pub fn is_done(&self) -> bool {
        matches!(self.task, Task::Rest)
    }

    /// One step: maps what is seen, then decides.
    ///
    /// # Errors
    /// When the ground cannot be mapped.
    pub fn step(
        &mut self,
        t_s: f64,
        packet: &FramePacket,
        located: &Located,
        localiser: &Localiser,
        motion: Motion,
    ) -> Result<Decision, TrialError> {
        self.see(t_s, packet, located, localiser)?;
        let pose = located.ground_from_body;
        let turned = self.heading.replace(pose.rotation.log()).map_or(0.0, |before| {
            let turn = pose.rotation.log() - before;
            turn - TAU * (turn / TAU).round()
        });
        let decision = if located.is_sure {
            if !located.sees_little {
                self.seen_heading = Some(pose.rotation.log());
            }
            self.act(t_s, &pose, motion, turned)?
        } else {
            let rate = self.finding_rate(&pose);
            let motion = self.towards(motion, Motion::new(0.0, rate));
            Decision { motion, state: State::Blocked, reason: None }
        };
        let decision = Decision { motion: slowed(decision.motion, located.sees_little), ..decision };
        self.note(t_s, &decision);
        Ok(decision)
    }

    /// The turn of a robot that is not sure of its place: back to where it last saw enough, then all around.
    fn finding_rate(&mut self, pose: &Se2) -> f64 {
        let off =
            self.seen_heading.map_or(0.0, |at| (cairn_geometry::So2::exp(at - pose.rotation.log())).log());
        if off.abs() < 0.1 {
            self.seen_heading = None;
        }
        if off < 0.0 { -FIND_RATE } else { FIND_RATE }
    }

    fn see(
        &mut self,
        t_s: f64,
        packet: &FramePacket,
        located: &Located,
        localiser: &Localiser,
    ) -> Result<(), TrialError> {
        if t_s - self.poses_s >= POSES_S {
            self.poses_s = t_s;
            let laid = self.ground.set_poses(|id| localiser.key_pose(id))?;
            self.laid_again += usize::from(laid.scans > 0);
            self.ground.costs().into_iter().for_each(|costs| self.once_open.learn(costs));
        }
        let (Some((id, key)), Some(depth)) = (located.key, &packet.depth) else { return Ok(()) };
        let key_from_body = key.inverse() * located.ground_from_body;
        if !self.stood {
            self.ground.stand(id, &key, key_from_body, self.config.start_free_m)?;
            self.stood = true;
        }
        let rays = self.scanner.scan(depth.data());
        let key_from_sensor = key_from_body * self.scanner.body_from_sensor();
        self.ground.observe(t_s, id, &key, key_from_sensor, &rays)?;
        Ok(())
    }

    fn act(&mut self, t_s: f64, pose: &Se2, motion: Motion, turned: f64) -> Result<Decision, TrialError> {
        Ok(match self.task.clone() {
            Task::Look { turned: before, then } => {
                let turned = before + turned;
                self.task = if turned < TAU {
                    Task::Look { turned, then }
                } else {
                    match then {
                        Then::Explore => Task::Explore,
                        Then::Visit { goal, began_s, tries } => {
                            self.navigator.set_goal(self.free_goal(self.goals[goal]));
                            Task::Visit { goal, began_s, tries }
                        }
                    }
                };
                self.turn(motion, LOOK_RATE)
            }
            Task::Aside(then) => {
                let decision = self.navigate(t_s, pose, motion);
                if matches!(decision.state, State::Reached | State::NoPath | State::Idle) {
                    self.task = Task::Look { turned: 0.0, then };
                }
                decision
            }
            Task::Explore => self.explore(t_s, pose, motion),
            Task::Face(at) => {
                let seen = pose.inverse() * at;
                let bearing = seen.y.atan2(seen.x);
                if bearing.abs() < 0.15 {
                    self.task = Task::Explore;
                    // Whatever is still unknown there cannot be seen from here.
                    self.given_up.push(at);
                }
                self.turn(motion, (1.5 * bearing).clamp(-LOOK_RATE, LOOK_RATE))
            }
            Task::Visit { goal, began_s, tries } => self.visit(t_s, pose, motion, goal, began_s, tries)?,
            Task::Rest => self.turn(motion, 0.0),
        })
    }

    fn explore(&mut self, t_s: f64, pose: &Se2, motion: Motion) -> Decision {
        if t_s > self.config.explore_s {
            return self.visit_next(t_s, 0, motion);
        }
        if let Some(target) = self.target.clone() {
            let middle = target.frontier.middle;
            let decision = self.navigate(t_s, pose, motion);
            match decision.state {
                State::Reached => (self.target, self.task) = (None, Task::Face(middle)),
                State::NoPath => {
                    self.given_up.push(middle);
                    self.target = None;
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
            return decision;
        }
        let next = self.next_frontier(pose);
        let Some(next) = next else {
            // What was given up may be reached now: someone stood in the door, the map was corrected.
            if self.rounds < ROUNDS && !self.given_up.is_empty() {
                self.rounds += 1;
                self.given_up.clear();
                self.task = Task::Look { turned: 0.0, then: Then::Explore };
                return self.turn(motion, 0.0);
            }
            return self.visit_next(t_s, 0, motion);
        };
        self.navigator.set_goal(next.goal);
        self.targets.push((t_s, next.goal, next.frontier.cells.len()));
        (self.target, self.checked_s) = (Some(next), t_s);
        self.navigate(t_s, pose, motion)
    }

    fn frontiers(&self) -> Vec<Frontier> {
        self.ground.map().map_or_else(Vec::new, |map| frontiers(map, &self.config.frontier))
    }

    fn next_frontier(&self, pose: &Se2) -> Option<Approach> {
        let costs = self.ground.costs()?;
        let from = costs.frame().cell_at(pose.translation)?;
        let open = |at: Vec2| self.given_up.iter().all(|g| (g - at).norm() > SAME_M);
        let mut all = self.frontiers();
        all.retain(|f| open(f.middle));
        let passable = costs.passable();
        // A body that stands a little too near to a wall starts from the free cell next to it.
        let from = nearest_free(&passable, from, 6)?;
        approaches(costs.map(), all, &passable, from, &self.config.frontier).into_iter().next()
    }

    /// A goal, or the free place nearest to it where it is blocked and there is one within the tolerance.
    fn free_goal(&self, goal: Vec2) -> Vec2 {
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
        let costs = self.ground.costs()?;
        let passable = costs.passable();
        let from = nearest_free(&passable, costs.frame().cell_at(pose.translation)?, 6)?;
        let target = Frontier { cells: vec![costs.frame().cell_at(goal)?], middle: goal };
        let config = FrontierConfig { approach_m: NEAR_GOAL_M, ..self.config.frontier };
        let all = approaches(costs.map(), vec![target], &passable, from, &config);
        all.first().map(|a| a.goal).filter(|at| (at - pose.translation).norm() > SAME_M)
    }

    /// The place before what blocks or hides the way to the goal, if that is not here.
    fn before_blockage(&self, pose: &Se2, goal: Vec2) -> Option<Vec2> {
        let costs = self.ground.costs()?;
        let from = nearest_free(&costs.passable(), costs.frame().cell_at(pose.translation)?, 6)?;
        let at = self.once_open.before_blockage(costs, from, self.free_goal(goal))?;
        Some(at).filter(|at| (at - pose.translation).norm() > SAME_M)
    }

    /// A free place about a metre away.
    fn aside(&mut self, pose: &Se2) -> Option<Vec2> {
        let passable = self.ground.costs()?.passable();
        let from = nearest_free(&passable, passable.frame().cell_at(pose.translation)?, 6)?;
        let mut search = cairn_plan::search::AStar::new();
        (0..40).find_map(|_| {
            let (angle, by_m) = (self.random.uniform(-PI, PI), self.random.uniform(0.7, 1.5));
            let at = pose.translation + Vec2::new(angle.cos(), angle.sin()) * by_m;
            let to = passable.frame().cell_at(at).filter(|c| passable.is_free(*c))?;
            let path = search.search(&passable, from, to).ok()?;
            (path.length_m(passable.frame()) < 2.0 * by_m).then_some(at)
        })
    }

    fn visit_next(&mut self, t_s: f64, goal: usize, motion: Motion) -> Decision {
        self.target = None;
        self.explored_s.get_or_insert(t_s);
        match self.goals.get(goal) {
            Some(&at) => {
                self.navigator.set_goal(self.free_goal(at));
                self.task = Task::Visit { goal, began_s: t_s, tries: 1 };
            }
            None => {
                self.navigator.cancel();
                self.task = Task::Rest;
            }
        }
        self.turn(motion, 0.0)
    }

    fn visit(
        &mut self,
        t_s: f64,
        pose: &Se2,
        motion: Motion,
        goal: usize,
        began_s: f64,
        tries: usize,
    ) -> Result<Decision, TrialError> {
        let decision = self.navigate(t_s, pose, motion);
        let late = t_s - began_s > self.config.goal_s;
        match decision.state {
            State::NoPath if tries < TRIES && !late => {
                // Someone who stood in a door may have gone since: that is seen when the robot comes near again.
                self.ground.forget_new()?;
                let then = Then::Visit { goal, began_s, tries: tries + 1 };
                self.task = Task::Look { turned: 0.0, then };
                // What is in the way may have gone: from near the goal that is seen best, else from another place.
                let at = self.goals[goal];
                let near = self.near_goal(pose, at).or_else(|| self.before_blockage(pose, at));
                if let Some(at) = near.or_else(|| if tries > 1 { self.aside(pose) } else { None }) {
                    self.navigator.set_goal(at);
                    self.task = Task::Aside(then);
                }
            }
            State::Reached | State::NoPath => self.end(t_s, goal, began_s, decision.state),
            state if late => self.end(t_s, goal, began_s, state),
            _ => {}
        }
        Ok(decision)
    }

    /// Records how a goal ended; the next one follows with the next step.
    fn end(&mut self, t_s: f64, goal: usize, began_s: f64, state: State) {
        let reason = match state {
            State::Reached => None,
            _ => Some(self.last_reason.map_or("no reason".to_owned(), |r| r.to_string())),
        };
        let late = (t_s - began_s > self.config.goal_s).then(|| format!("after {:.0} s", t_s - began_s));
        let reason = match (reason, late) {
            (Some(reason), Some(late)) => Some(format!("{reason}, {late}")),
            (reason, _) => reason,
        };
        self.ends.push(GoalEnd { state: state.to_string(), reason, seconds: t_s - began_s });
        self.visit_next(t_s, goal + 1, Motion::stop());
    }

    fn navigate(&mut self, t_s: f64, pose: &Se2, motion: Motion) -> Decision {
        let (Some(costs), Some(local)) = (self.ground.costs(), self.ground.local()) else {
            return self.turn(motion, 0.0);
        };
        let moving = Some(self.ground.moving());
        let step = self.navigator.step_locally(t_s, pose, motion, costs, local, moving);
        self.plans += usize::from(step.state == State::Planning);
        self.last_reason = step.reason.or(self.last_reason);
        Decision { motion: step.motion, state: step.state, reason: step.reason }
    }

    /// Turns on the spot.
    fn turn(&self, motion: Motion, rate: f64) -> Decision {
        let motion = self.towards(motion, Motion::new(0.0, rate));
        Decision { motion, state: State::Idle, reason: None }
    }

    fn towards(&self, motion: Motion, wish: Motion) -> Motion {
        let p = &self.config.navigator.pursuit;
        p.limits.reachable(motion, wish, p.period_s)
    }

    fn note(&mut self, t_s: f64, decision: &Decision) {
        if self.states.last().is_none_or(|(_, state, _)| *state != decision.state) {
            self.states.push((t_s, decision.state, decision.reason.map(|r| r.to_string())));
        }
    }
}

/// A motion along the same curve, slow enough for a robot that sees little.
fn slowed(motion: Motion, sees_little: bool) -> Motion {
    let rate = motion.angular.abs();
    if !sees_little || rate <= PLAIN_RATE {
        return motion;
    }
    Motion::new(motion.linear * PLAIN_RATE / rate, motion.angular * PLAIN_RATE / rate)
}

/// The nearest free cell within some cells of another.
fn nearest_free(
    passable: &cairn_plan::Passable,
    from: cairn_plan::Cell,
    reach: i32,
) -> Option<cairn_plan::Cell> {
    let offsets = (-reach..=reach).flat_map(|dy| (-reach..=reach).map(move |dx| (dx, dy)));
    let at = |(dx, dy): (i32, i32)| {
        cairn_plan::Cell::new(from.x.wrapping_add_signed(dx), from.y.wrapping_add_signed(dy))
    };
    let free = offsets.filter(|o| passable.is_free(at(*o)));
    free.min_by_key(|(dx, dy)| dx * dx + dy * dy).map(at)
}
