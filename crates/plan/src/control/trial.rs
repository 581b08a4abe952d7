//! A simulated body to test followers: it moves with a delay and within its limits, and its odometry is noisy.

use super::motion::{Limits, Twist, moved};
use super::navigator::Navigator;
use super::step::{Reason, State};
use crate::costmap::{Costmap, DynamicLayer};
use cairn_geometry::{Se2, Vec2};
use cairn_random::Random;
use std::collections::VecDeque;

/// A body that executes commands after a delay.
#[derive(Clone, Debug)]
pub struct SimulatedBody {
    /// True pose.
    pub truth: Se2,
    /// True motion.
    pub motion: Twist,
    /// Pose according to the odometry.
    pub odometry: Se2,
    limits: Limits,
    noise: f64,
    fix_every_s: f64,
    since_fix_s: f64,
    waiting: VecDeque<Twist>,
    random: Random,
}

/// Standard deviations of a fix: along each axis in metres, and of the heading in radians.
const FIX: (f64, f64) = (0.01, 0.003);

/// Time of a step of the simulation, in seconds.
const STEP_S: f64 = 0.005;

impl SimulatedBody {
    /// At rest. Commands take effect `delay_s` later. Each increment of the odometry over a command period has a
    /// relative error, in distance and in turn, that is normal with standard deviation `noise` (0.02 for 2 %). Every
    /// `fix_every_s` seconds (never, for infinity) the odometry is corrected to 1 cm and 0.003 rad, as localisation in
    /// a map does.
    pub fn new(at: Se2, limits: Limits, delay_s: f64, noise: f64, fix_every_s: f64, seed: u64) -> Self {
        let late = (delay_s / STEP_S).round().clamp(0.0, 10_000.0) as usize;
        Self {
            truth: at,
            odometry: at,
            motion: Twist::stop(),
            limits,
            noise,
            fix_every_s,
            since_fix_s: 0.0,
            waiting: VecDeque::from(vec![Twist::stop(); late]),
            random: Random::new(seed),
        }
    }

    /// Simulates for a time under one command; `see` is called with the true pose every 5 ms.
    pub fn go(&mut self, order: Twist, for_s: f64, mut see: impl FnMut(&Se2)) {
        let before = self.truth;
        for _ in 0..(for_s / STEP_S).round() as usize {
            self.waiting.push_back(order);
            let delayed = self.waiting.pop_front().unwrap_or(order);
            self.motion = self.limits.reachable(self.motion, delayed, STEP_S);
            self.truth = moved(&self.truth, self.motion, STEP_S);
            see(&self.truth);
        }
        let step = before.inverse() * self.truth;
        let long = 1.0 + self.random.normal(0.0, self.noise);
        let turn = step.rotation.log() * (1.0 + self.random.normal(0.0, self.noise));
        self.odometry =
            self.odometry * Se2::from_xy_angle(step.translation.x * long, step.translation.y * long, turn);
        self.since_fix_s += for_s;
        if self.since_fix_s >= self.fix_every_s {
            self.since_fix_s = 0.0;
            let [x, y, angle] = [FIX.0, FIX.0, FIX.1].map(|sigma| self.random.normal(0.0, sigma));
            self.odometry = self.truth * Se2::from_xy_angle(x, y, angle);
        }
    }
}

/// Quality of a drive to a goal, judged by the true poses.
#[derive(Clone, Debug, PartialEq)]
pub struct Drive {
    /// The state at the end.
    pub state: State,
    /// The last reason given.
    pub reason: Option<Reason>,
    /// Simulated time in seconds.
    pub seconds: f64,
    /// Distance driven in metres.
    pub length_m: f64,
    /// Root mean square of the lateral offset from the path, in metres, while moving.
    pub lateral_rms_m: f64,
    /// The same by the body's own odometry: the error of following alone, without that of the odometry.
    pub own_lateral_rms_m: f64,
    /// Greatest lateral offset from the path, in metres.
    pub lateral_max_m: f64,
    /// Least distance from the rim of the body to a wall, in metres, measured to the squares of the cells; below 0 it
    /// touched.
    pub clearance_m: f64,
    /// Distance to the goal at the end, in metres.
    pub to_goal_m: f64,
    /// How often the turn changed sides by more than 0.2 rad/s within the last metre before the goal.
    pub reversals: usize,
    /// How often a path was planned.
    pub plans: usize,
}

/// Drives a body to a goal, for at most `most_s` of simulated time. `moving` gives the moving objects at each time.
pub fn drive(
    navigator: &mut Navigator,
    body: &mut SimulatedBody,
    goal: Vec2,
    costs: &Costmap,
    mut moving: impl FnMut(f64) -> Option<DynamicLayer>,
    most_s: f64,
) -> Drive {
    let (period_s, radius_m) = (navigator.config().pursuit.period_s, costs.config().radius_m);
    navigator.set_goal(goal);
    let mut drive = Drive {
        state: State::Planning,
        reason: None,
        seconds: 0.0,
        length_m: 0.0,
        lateral_rms_m: 0.0,
        own_lateral_rms_m: 0.0,
        lateral_max_m: 0.0,
        clearance_m: f64::INFINITY,
        to_goal_m: f64::INFINITY,
        reversals: 0,
        plans: 0,
    };
    let (mut sum, mut count, mut along_m, mut side) = (0.0, 0usize, 0.0, 0.0f64);
    let (mut own_sum, mut own_count) = (0.0, 0usize);
    while drive.seconds < most_s {
        let layer = moving(drive.seconds);
        let step = navigator.step(drive.seconds, &body.odometry, body.motion, costs, layer.as_ref());
        drive.state = step.state;
        drive.reason = step.reason.or(drive.reason);
        if step.state == State::Planning {
            drive.plans += 1;
            along_m = 0.0;
        }
        if matches!(step.state, State::Reached | State::NoPath) {
            break;
        }
        if let Some(following) = step.following.filter(|f| f.motion.linear > 1e-3) {
            own_sum += following.projection.lateral_m.powi(2);
            own_count += 1;
        }
        let near = (body.truth.translation - goal).norm() < 1.0;
        if near && step.motion.angular.abs() > 0.2 && step.motion.angular * side < 0.0 {
            drive.reversals += 1;
        }
        if step.motion.angular.abs() > 0.2 {
            side = step.motion.angular;
        }
        let path = navigator.path().cloned();
        let mut last = body.truth.translation;
        body.go(step.motion, period_s, |truth| {
            let clear = costs.field().distance_to_square_m(truth.translation) - radius_m;
            drive.clearance_m = drive.clearance_m.min(clear);
            let gone = (truth.translation - last).norm();
            last = truth.translation;
            drive.length_m += gone;
            if let Some(path) = path.as_ref().filter(|_| gone > 1e-5) {
                let at = path.project(truth.translation, along_m - 0.3, along_m + 1.0);
                along_m = at.along_m;
                sum += at.lateral_m * at.lateral_m;
                count += 1;
                drive.lateral_max_m = drive.lateral_max_m.max(at.lateral_m.abs());
            }
        });
        drive.seconds += period_s;
    }
    drive.lateral_rms_m = (sum / count.max(1) as f64).sqrt();
    drive.own_lateral_rms_m = (own_sum / own_count.max(1) as f64).sqrt();
    drive.to_goal_m = (body.truth.translation - goal).norm();
    drive
}
