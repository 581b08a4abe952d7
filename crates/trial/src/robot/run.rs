//! One trial from switching on to the last goal.

use super::household::Household;
use super::judge::{Collision, Judge};
use super::localiser::{Localiser, over_ground};
use super::pilot::Pilot;
use super::{RobotConfig, TrialError};
use cairn_geometry::{Se2, Vec2};
use cairn_plan::Grid;
use cairn_plan::control::State;
use cairn_plan::control::trial::SimulatedBody;
use cairn_sensor::{Host, Stamp};
use cairn_sim::{LiveRig, World};
use serde::Serialize;
use std::sync::Arc;

/// The door closes when the robot has driven this far towards the second goal, metres.
const DOOR_AFTER_M: f64 = 0.3;
/// The goals, by their place among those of the world; the door of the second one closes.
const GOALS: [usize; 3] = [4, 0, 2];

/// How a goal ended, by the robot's word and by the truth.
#[derive(Clone, Debug, Serialize)]
pub struct Goal {
    /// Name of the room.
    pub name: String,
    /// True place, metres.
    pub at: [f64; 2],
    /// REACHED, NO_PATH, or the state in which time ran out.
    pub state: String,
    /// Why it was not reached.
    pub reason: Option<String>,
    /// The robot said REACHED and truly stands there.
    pub reached: bool,
    /// True distance from the goal at the end, metres.
    pub error_m: f64,
    /// From the order to the end, seconds; both tries together, where there were two.
    pub seconds: f64,
    /// How often it was tried: twice where the first time others were in the way.
    pub tries: usize,
}

/// The robot at one frame.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// Seconds.
    pub t_s: f64,
    /// True pose.
    pub truth: Se2,
    /// Pose by the robot's own account, laid into the world by where it was switched on.
    pub estimate: Se2,
    /// State of its navigator.
    pub state: State,
    /// The goal it is driving to; `None` while it explores.
    pub goal: Option<usize>,
}

/// Everything that a trial leaves.
#[derive(Clone)]
pub struct End {
    /// Each goal.
    pub goals: Vec<Goal>,
    /// All touches.
    pub collisions: Vec<Collision>,
    /// Least distance from the rim of the robot to a wall and to a person, metres.
    pub clearance_m: [f64; 2],
    /// Driven in all, metres.
    pub driven_m: f64,
    /// When exploration ended, seconds.
    pub explored_s: f64,
    /// The whole trial, simulated seconds.
    pub seconds: f64,
    /// Share of the floor where the robot fits that it knows to be free.
    pub known: f64,
    /// Root mean square and greatest error of its position, metres.
    pub position_error_m: [f64; 2],
    /// Frames that were not tracked.
    pub lost: usize,
    /// Frames whose pose the engine carried on by the wheels, because it saw too little.
    pub coasted: usize,
    /// Frames whose tracked pose was not that of the wheels, and was not used.
    pub refused: usize,
    /// Loops and merges accepted, and how often the grid was laid again.
    pub loops: [usize; 2],
    /// When the door closed, seconds.
    pub door_closed_s: Option<f64>,
    /// How often a path was planned.
    pub plans: usize,
    /// Frontiers driven to: seconds, true place, cells.
    pub targets: Vec<(f64, Vec2, usize)>,
    /// Changes of the navigator's state: seconds, state, reason.
    pub states: Vec<(f64, State, Option<String>)>,
    /// Milliseconds from image to pose, frame by frame.
    pub step_ms: Vec<f64>,
    /// Milliseconds of mapping and deciding, frame by frame.
    pub plan_ms: Vec<f64>,
    /// Each frame.
    pub path: Vec<Moment>,
    /// Its map of the ground, laid into the world by where it was switched on.
    pub map: Option<Grid<i8>>,
    /// The world at the end.
    pub world: Arc<World>,
}

/// What a caller is told while a trial runs.
#[derive(Clone, Copy, Debug)]
pub struct Progress {
    /// Simulated seconds.
    pub t_s: f64,
    /// Tries for goals that have ended.
    pub goals: usize,
}

/// A trial that is ready to run.
pub struct Trial {
    config: RobotConfig,
    household: Household,
    rig: LiveRig,
    localiser: Localiser,
    pilot: Pilot,
    body: SimulatedBody,
    judge: Judge,
    start: Se2,
    door_closed_s: Option<f64>,
    ordered_at_m: Option<f64>,
    path: Vec<Moment>,
    plan_ms: Vec<f64>,
    /// True distance from the goal at the end of each try.
    errors: Vec<f64>,
}

impl Trial {
    /// Builds the world and switches the robot on, with the clock of a host.
    ///
    /// # Errors
    /// When the world or the rig cannot be simulated.
    pub fn new(config: RobotConfig, host: &Host) -> Result<Self, TrialError> {
        let household = Household::new(&config);
        let rig = LiveRig::in_world(&config.sim, Arc::clone(household.world()))?;
        let localiser = Localiser::new(rig.rig(), config.sim.rate_hz, host)?;
        let start = household.start();
        let goals = goals(household.world()).map(|(_, at)| start.inverse() * at).collect();
        let pilot = Pilot::new(&config, goals)?;
        let limits = config.navigator.pursuit.limits;
        let body =
            SimulatedBody::new(start, limits, config.delay_s, config.wheel_noise, f64::INFINITY, config.seed);
        let judge = Judge::new(config.radius_m);
        Ok(Self {
            config,
            household,
            rig,
            localiser,
            pilot,
            body,
            judge,
            start,
            door_closed_s: None,
            ordered_at_m: None,
            path: Vec::new(),
            plan_ms: Vec::new(),
            errors: Vec::new(),
        })
    }

    /// Runs to the end; `told` hears of every frame.
    ///
    /// # Errors
    /// When the renderer or the engine fails.
    pub fn run(mut self, mut told: impl FnMut(Progress)) -> Result<End, TrialError> {
        let dt = self.config.step_s();
        // Each goal may come twice.
        let most_s = self.config.explore_s + 2.0 * (GOALS.len() as f64) * self.config.goal_s + 10.0;
        let mut t_s = 0.0;
        let mut wheels = Se2::identity();
        for frame in 0u32.. {
            t_s = f64::from(frame) * dt;
            if self.pilot.is_done() || t_s > most_s {
                break;
            }
            wheels = self.frame(t_s, dt, wheels)?;
            told(Progress { t_s, goals: self.pilot.ends().len() });
        }
        Ok(self.end(t_s))
    }

    /// One frame: render, locate, decide, move. Returns what the wheels measured.
    fn frame(&mut self, t_s: f64, dt: f64, wheels: Se2) -> Result<Se2, TrialError> {
        self.household.step(dt, self.body.truth.translation);
        self.close_door(t_s);
        self.rig.set_people(&self.household.figures());
        let packet = self.rig.packet(Stamp::from_seconds(t_s), &over_ground(&self.body.truth))?;
        let located = self.localiser.step(&packet, wheels)?;
        let began = std::time::Instant::now();
        let decision = self.pilot.step(t_s, &packet, &located, &self.localiser, self.body.motion)?;
        self.plan_ms.push(began.elapsed().as_secs_f64() * 1e3);
        let estimate = self.start * located.ground_from_body;
        self.path.push(Moment {
            t_s,
            truth: self.body.truth,
            estimate,
            state: decision.state,
            goal: self.pilot.goal(),
        });
        let places: Vec<Vec2> = goals(self.household.world()).map(|(_, at)| at).collect();
        let ended = self.pilot.ends().iter().skip(self.errors.len()).filter_map(|e| places.get(e.goal));
        self.errors.extend(ended.map(|at| (self.body.truth.translation - at).norm()));
        let before = self.body.odometry;
        let (judge, household) = (&mut self.judge, &self.household);
        let speed = self.body.motion.linear.abs();
        self.body.go(decision.motion, dt, |truth| judge.see(t_s, truth.translation, speed, household));
        Ok(before.inverse() * self.body.odometry)
    }

    /// Closes the door once the robot is on its way to the room behind it.
    fn close_door(&mut self, t_s: f64) {
        if self.pilot.goal() != Some(1) || self.door_closed_s.is_some() {
            return;
        }
        let driven_m = self.judge.driven_m;
        let ordered_at_m = *self.ordered_at_m.get_or_insert(driven_m);
        if driven_m - ordered_at_m > DOOR_AFTER_M && self.household.close_door(self.body.truth.translation) {
            self.door_closed_s = Some(t_s);
            self.rig.set_world(self.household.world());
        }
    }

    fn end(self, seconds: f64) -> End {
        let world = Arc::clone(self.household.world());
        let goals = goals(&world).enumerate().map(|(k, (name, at))| {
            let tries = || self.pilot.ends().iter().zip(&self.errors).filter(|(end, _)| end.goal == k);
            let last = tries().next_back();
            let (end, error_m) = (last.map(|(end, _)| end), last.map_or(f64::INFINITY, |(_, error)| *error));
            let state = end.map_or("not tried".to_owned(), |e| e.state.clone());
            let reached = end.is_some_and(|e| e.state == State::Reached.to_string());
            Goal {
                name,
                at: at.into(),
                reached: reached && error_m <= self.config.arrival_m,
                state,
                reason: match end {
                    Some(end) => end.reason.clone(),
                    None => Some("the time was over before its turn came".to_owned()),
                },
                error_m,
                seconds: tries().map(|(end, _)| end.seconds).sum(),
                tries: tries().count(),
            }
        });
        let goals = goals.collect();
        let error = |m: &Moment| (m.truth.translation - m.estimate.translation).norm();
        let count = self.path.len().max(1) as f64;
        let rms = (self.path.iter().map(|m| error(m).powi(2)).sum::<f64>() / count).sqrt();
        let map = self.pilot.ground().map().and_then(|map| laid_into(map, &self.start));
        End {
            goals,
            collisions: self.judge.collisions,
            clearance_m: [self.judge.wall_clearance_m, self.judge.person_clearance_m],
            driven_m: self.judge.driven_m,
            explored_s: self.pilot.explored_s.unwrap_or(seconds),
            seconds,
            known: map.as_ref().map_or(0.0, |map| known(map, &world, self.config.radius_m)),
            position_error_m: [rms, self.path.iter().map(error).fold(0.0, f64::max)],
            lost: self.localiser.lost,
            coasted: self.localiser.coasted,
            refused: self.localiser.refused,
            loops: [self.localiser.loops, self.pilot.laid_again],
            door_closed_s: self.door_closed_s,
            plans: self.pilot.plans,
            targets: self.pilot.targets.iter().map(|(t, at, n)| (*t, self.start * *at, *n)).collect(),
            states: self.pilot.states,
            step_ms: self.localiser.step_ms,
            plan_ms: self.plan_ms,
            path: self.path,
            map,
            world,
        }
    }
}

/// The goals of a world: name and place.
fn goals(world: &World) -> impl Iterator<Item = (String, Vec2)> + '_ {
    GOALS.iter().filter_map(|&k| world.places().get(k).cloned())
}

/// The same map in a frame moved by a pose.
fn laid_into(map: &Grid<i8>, world_from_ground: &Se2) -> Option<Grid<i8>> {
    let frame = map.frame();
    let pose = *world_from_ground * frame.world_from_grid();
    let frame = cairn_plan::GridFrame::new(frame.width(), frame.height(), frame.resolution_m(), pose).ok()?;
    Grid::from_values(frame, map.values().to_vec()).ok()
}

/// Share of the places in steps of 0.1 m where a robot fits that the map calls free.
fn known(map: &Grid<i8>, world: &World, radius_m: f64) -> f64 {
    let corners = world.plan().iter().flat_map(|(a, b)| [*a, *b]);
    let (mut low, mut high) = (Vec2::repeat(f64::INFINITY), Vec2::repeat(f64::NEG_INFINITY));
    corners.for_each(|p| (low, high) = (low.inf(&p), high.sup(&p)));
    let steps = ((high - low) / 0.1).map(|v| v.max(0.0) as usize);
    let (mut free, mut seen) = (0usize, 0usize);
    for y in 0..steps.y {
        for x in 0..steps.x {
            let at = low + Vec2::new(x as f64 + 0.5, y as f64 + 0.5) * 0.1;
            if world.clearance(at.x, at.y) > radius_m {
                free += 1;
                seen += usize::from(map.frame().cell_at(at).and_then(|c| map.get(c)) == Some(0));
            }
        }
    }
    seen as f64 / free.max(1) as f64
}
