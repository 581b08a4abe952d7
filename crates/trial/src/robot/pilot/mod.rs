//! What the robot does: looks around, explores by frontiers, then visits its goals.
//!
//! In: where it is and what it sees. Out: the motion to command, the navigator's state and the reason for it.

mod explore;
mod let_pass;
mod visit;

use super::RobotConfig;
use super::errands::Errands;
use super::localiser::{Localiser, Located};
use super::once_open::OnceOpen;
use super::{GoalEnd, TrialError};
use cairn_atlas::KeyFrameId;
use cairn_geometry::{Se2, Vec2};
use cairn_plan::control::{Navigator, Reason, State, Twist, way_out};
use cairn_plan::depth_scan::{DepthCamera, DepthScanner};
use cairn_plan::frontier::Approach;
use cairn_plan::give_way::{LastSeen, Trails};
use cairn_plan::ground::GroundMap;
use cairn_random::Random;
use cairn_sensor::FramePacket;
use std::f64::consts::TAU;

/// Rate at which the robot turns to look around, rad/s.
const LOOK_RATE: f64 = 1.0;
/// The poses of all key frames are compared with the grid's after this time, seconds.
const POSES_S: f64 = 2.0;
/// In front of a plain wall the robot turns no faster than this, rad/s: from image to image enough must stay in view.
const PLAIN_RATE: f64 = 0.5;
/// A robot that is no longer sure of its place turns at this rate, rad/s: back to where it was, then on all around.
const FIND_RATE: f64 = 0.4;
/// Places this near to each other are the same, metres.
const SAME_M: f64 = 0.5;

/// What the robot is about.
#[derive(Clone, Debug)]
enum Task {
    /// Turning once around.
    Look { turned: f64, then: Then },
    /// Driving to frontiers.
    Explore,
    /// Turning towards a frontier that was reached and has not gone.
    Face(Vec2),
    /// Driving elsewhere, to see from there what seemed to be in the way, or to let pass whoever was met.
    Aside { met: Option<Vec2>, then: Then },
    /// Standing aside and watching the place where someone was met, until he has left it.
    LetPass { met: Vec2, from_s: f64, clear_from_s: Option<f64>, then: Then },
    /// Driving to a goal.
    Visit { goal: usize, began_s: f64 },
    /// All is done.
    Rest,
}

/// What follows a look around or a wait.
#[derive(Clone, Copy, Debug)]
enum Then {
    Explore,
    Visit { goal: usize, began_s: f64 },
}

/// The command of a step, and why.
#[derive(Clone, Copy, Debug)]
pub struct Decision {
    /// The motion to command.
    pub motion: Twist,
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
    trails: Trails,
    last_seen: LastSeen,
    navigator: Navigator,
    task: Task,
    target: Option<Approach>,
    /// Frontiers that could not be reached, and those that were looked at from near by and stayed.
    given_up: Vec<Vec2>,
    faced: Vec<Vec2>,
    /// How often the frontiers that were given up have been tried again.
    rounds: usize,
    /// How often what had come to stand was forgotten, or someone was let pass, since a frontier was last reached.
    unblocked: usize,
    /// How often nothing could be done for the present goal.
    helpless: usize,
    /// Whether the present goal was looked at from near by.
    looked_near: bool,
    /// Whom the robot last let pass for the present goal: where he stood.
    let_pass_at: Option<Vec2>,
    /// Where the robot last looked around.
    looked_at: Option<Vec2>,
    checked_s: f64,
    poses_s: f64,
    heading: Option<f64>,
    /// Where it looked when it was last sure of its place and saw enough, radians.
    seen_heading: Option<f64>,
    stood: bool,
    goals: Vec<Vec2>,
    errands: Errands,
    /// Whether someone was in the way to the present goal.
    held_up: bool,
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
            trails: Trails::default(),
            last_seen: LastSeen::default(),
            navigator: Navigator::new(config.navigator),
            task: Task::Look { turned: 0.0, then: Then::Explore },
            target: None,
            given_up: Vec::new(),
            faced: Vec::new(),
            rounds: 0,
            unblocked: 0,
            helpless: 0,
            looked_near: false,
            let_pass_at: None,
            looked_at: None,
            checked_s: 0.0,
            poses_s: 0.0,
            heading: None,
            seen_heading: None,
            stood: false,
            errands: Errands::new(goals.len()),
            goals,
            held_up: false,
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
            | Task::Aside { then: Then::Visit { goal, .. }, .. }
            | Task::LetPass { then: Then::Visit { goal, .. }, .. }
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
        motion: Twist,
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
            let motion = self.towards(motion, Twist::new(0.0, rate));
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
        self.trails.learn(self.ground.moving());
        self.last_seen.learn(t_s, self.ground.moving());
        Ok(())
    }

    fn act(&mut self, t_s: f64, pose: &Se2, motion: Twist, turned: f64) -> Result<Decision, TrialError> {
        Ok(match self.task.clone() {
            Task::Look { then, .. } | Task::Aside { then, .. } | Task::LetPass { then, .. }
                if self.is_late(t_s, &then).is_some() =>
            {
                let (goal, began_s) = self.is_late(t_s, &then).unwrap_or_default();
                self.end(t_s, goal, began_s, State::NoPath);
                self.turn(motion, 0.0)
            }
            Task::Look { turned: before, then } => {
                let turned = before + turned;
                if turned < TAU {
                    self.task = Task::Look { turned, then };
                } else {
                    self.looked_at = Some(pose.translation);
                    self.go_on(then);
                }
                self.turn(motion, LOOK_RATE)
            }
            Task::Aside { met, then } => {
                let decision = self.navigate(t_s, pose, motion);
                if matches!(decision.state, State::Reached | State::NoPath | State::Idle) {
                    self.task = match met {
                        Some(met) => Task::LetPass { met, from_s: t_s, clear_from_s: None, then },
                        None => Task::Look { turned: 0.0, then },
                    };
                }
                decision
            }
            Task::LetPass { met, from_s, clear_from_s, then } => {
                self.stand_aside(t_s, pose, motion, (met, from_s, clear_from_s, then))
            }
            Task::Explore => self.explore(t_s, pose, motion)?,
            Task::Face(at) => {
                let seen = pose.inverse() * at;
                let bearing = seen.y.atan2(seen.x);
                if bearing.abs() < 0.15 {
                    self.task = Task::Explore;
                    // Whatever is still unknown there cannot be seen from here.
                    self.faced.push(at);
                }
                self.turn(motion, (1.5 * bearing).clamp(-LOOK_RATE, LOOK_RATE))
            }
            Task::Visit { goal, began_s } => self.visit(t_s, pose, motion, goal, began_s)?,
            Task::Rest => self.turn(motion, 0.0),
        })
    }

    /// The free cell where drives begin: that of the robot, or the end of its way out of ground that is too near to an obstacle.
    fn own_cell(&self, pose: &Se2) -> Option<cairn_plan::Cell> {
        let costs = self.ground.costs()?;
        let own = costs.frame().cell_at(pose.translation)?;
        way_out(costs, own, self.config.navigator.way_out_m)?.last().copied()
    }

    /// Drives to a place, looks around there, and goes on.
    fn look_from(&mut self, at: Vec2, then: Then) {
        self.navigator.set_goal(at);
        self.task = Task::Aside { met: None, then };
    }

    /// What comes after a look around or a wait.
    fn go_on(&mut self, then: Then) {
        self.task = match then {
            Then::Explore => Task::Explore,
            Then::Visit { goal, began_s } => {
                self.navigator.set_goal(self.free_goal(self.goals[goal]));
                Task::Visit { goal, began_s }
            }
        };
    }

    /// How each try for a goal ended, in order.
    pub fn ends(&self) -> &[GoalEnd] {
        self.errands.ends()
    }

    fn navigate(&mut self, t_s: f64, pose: &Se2, motion: Twist) -> Decision {
        let (Some(costs), Some(local)) = (self.ground.costs(), self.ground.local()) else {
            return self.turn(motion, 0.0);
        };
        let moving = Some(self.ground.moving());
        let step = self.navigator.step_locally(t_s, pose, motion, costs, local, moving);
        self.plans += usize::from(step.state == State::Planning);
        self.last_reason = step.reason.or(self.last_reason);
        self.held_up |= matches!(step.reason, Some(Reason::Moving(_)));
        Decision { motion: step.motion, state: step.state, reason: step.reason }
    }

    /// Turns on the spot.
    fn turn(&self, motion: Twist, rate: f64) -> Decision {
        let motion = self.towards(motion, Twist::new(0.0, rate));
        Decision { motion, state: State::Idle, reason: None }
    }

    fn towards(&self, motion: Twist, wish: Twist) -> Twist {
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
fn slowed(motion: Twist, sees_little: bool) -> Twist {
    let rate = motion.angular.abs();
    if !sees_little || rate <= PLAIN_RATE {
        return motion;
    }
    Twist::new(motion.linear * PLAIN_RATE / rate, motion.angular * PLAIN_RATE / rate)
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
