//! Model predictive path integral control (Williams, Aldrich and Theodorou, "Model Predictive Path Integral Control",
//! 2017, algorithm 2; weights of equation 34): many noisy variants of the last plan are rolled out within the limits of
//! the body. Each gets a cost for leaving the path, for lagging and for walls, and the new plan is their mean, weighted
//! by `exp(-cost)`.
//!
//! The roll-outs are stored as a structure of arrays, so that the compiler vectorises the plain loops; headings are
//! stored as cosine and sine and rotated by short polynomials. The noise is drawn once; each step starts at another
//! offset in it, chosen by the seed.

use super::ahead::Surroundings;
use super::delay::PendingCommands;
use super::motion::{Limits, Twist};
use super::pursuit::Following;
use super::reference::{Progress, ReferencePath};
use cairn_geometry::{Se2, Vec2};
use cairn_random::Random;

/// Number and length of the roll-outs, and the cost weights.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MppiConfig {
    /// Limits of the body.
    pub limits: Limits,
    /// Number of variants rolled out, at least 1.
    pub rollouts: usize,
    /// Steps of each roll-out, at least 1.
    pub steps: usize,
    /// Duration of a step, and the time between two calls, in seconds.
    pub period_s: f64,
    /// Delay from command to motion, in seconds.
    pub delay_s: f64,
    /// Standard deviations of the noise: m/s and rad/s.
    pub noise: (f64, f64),
    /// Cost difference that makes a variant `e` times less likely.
    pub temperature: f64,
    /// Cost of a squared metre beside the path (`lateral`), and of one before or behind the point to be reached
    /// (`lag`).
    pub lateral: f64,
    /// See `lateral`.
    pub lag: f64,
    /// Cost of facing across the path (twice that for facing backwards).
    pub heading: f64,
    /// Cost of touching a wall, and of being within `near_m` of one.
    pub touch: f64,
    /// Distance beyond the radius up to which a wall has a cost, in metres.
    pub near_m: f64,
    /// Greatest lateral acceleration in curves, in m/s^2.
    pub lateral_acceleration: f64,
    /// Distance kept between the body and an obstacle in its way, in metres.
    pub stop_distance_m: f64,
    /// The goal is reached within this distance, in metres.
    pub goal_tolerance_m: f64,
    /// Seed of the noise.
    pub seed: u64,
}

impl MppiConfig {
    /// Defaults that suit the limits of a body.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            rollouts: 400,
            steps: 20,
            period_s: 0.05,
            delay_s: 0.05,
            noise: (0.15, 0.5),
            temperature: 0.05,
            lateral: 8.0,
            lag: 1.0,
            heading: 0.6,
            touch: 1e3,
            near_m: 0.1,
            lateral_acceleration: 0.6,
            stop_distance_m: 0.1,
            goal_tolerance_m: 0.1,
            seed: 1,
        }
    }
}

/// Reference position and heading at one step, in cells of the grid.
#[derive(Clone, Copy, Default)]
struct Target {
    x: f32,
    y: f32,
    dx: f32,
    dy: f32,
}

/// All roll-outs at one step, as one array per quantity.
#[derive(Clone, Default)]
struct Rollouts {
    x: Vec<f32>,
    y: Vec<f32>,
    cos: Vec<f32>,
    sin: Vec<f32>,
    linear: Vec<f32>,
    angular: Vec<f32>,
    cost: Vec<f32>,
}

/// The controller; its plan carries over from step to step.
#[derive(Clone)]
pub struct Mppi {
    config: MppiConfig,
    plan: Vec<Twist>,
    noise: Vec<f32>,
    random: Random,
    rollouts: Rollouts,
    /// Noise of each step and roll-out: of the speed and of the yaw rate.
    linear_noise: Vec<f32>,
    angular_noise: Vec<f32>,
    along_m: f64,
    reached: bool,
    pending: PendingCommands,
}

/// Size of the table of noise samples.
const NOISE: usize = 1 << 15;
/// Part of the noise that carries over from one step to the next (time correlation).
const KEEP: f32 = 0.8;

impl Mppi {
    /// At rest at the beginning of a path.
    pub fn new(mut config: MppiConfig) -> Self {
        (config.rollouts, config.steps) = (config.rollouts.clamp(1, NOISE / 4), config.steps.clamp(1, 1000));
        if config.limits.check().is_err() {
            config.limits = Limits::standing();
        }
        let mut random = Random::new(config.seed);
        let noise = (0..NOISE).map(|_| random.normal(0.0, 1.0) as f32).collect();
        let all = config.rollouts * config.steps;
        Self {
            config,
            plan: vec![Twist::stop(); config.steps],
            noise,
            random,
            rollouts: Rollouts::default(),
            linear_noise: vec![0.0; all],
            angular_noise: vec![0.0; all],
            along_m: 0.0,
            reached: false,
            pending: PendingCommands::new(config.delay_s, config.period_s),
        }
    }

    /// The configuration.
    pub fn config(&self) -> &MppiConfig {
        &self.config
    }

    /// Switches to another path, starting `along_m` from its beginning; earlier commands still count.
    pub fn restart(&mut self, along_m: f64) {
        (self.along_m, self.reached) = (along_m, false);
        self.plan.fill(Twist::stop());
    }

    /// Records a command that came from elsewhere: a turn in place or a recovery.
    pub fn commanded(&mut self, motion: Twist) {
        self.pending.push(motion);
    }

    /// One control step: the command for the current pose and motion.
    pub fn step(
        &mut self,
        world_from_body: &Se2,
        motion: Twist,
        path: &ReferencePath,
        around: &Surroundings,
    ) -> Following {
        let c = self.config;
        let (pose, now) = self.pending.foreseen(world_from_body, motion);
        let here = path.progress(pose.translation, self.along_m, c.goal_tolerance_m);
        let Progress { projection, left_m, at_end } = here;
        (self.along_m, self.reached) = (projection.along_m, self.reached || at_end);
        let targets = self.targets(path, around, now);
        self.plan.rotate_left(1);
        if let [.., before, last] = self.plan.as_mut_slice() {
            *last = *before;
        }
        self.roll_out(&pose, now, &targets, around);
        self.improve();
        let wish = self.plan.first().copied().unwrap_or_default();
        let curvature = wish.angular / wish.linear.max(0.1);
        let reach_m = (now.linear.max(0.0) + 0.3).min(left_m);
        let arc = Twist::new(1.0, curvature);
        let ahead =
            around.ahead(&pose, arc, 0.3f64.min(left_m), Some((path, projection.along_m + 0.3)), reach_m);
        let blocked = ahead.blocked && ahead.free_m <= c.stop_distance_m;
        let mut wish = if self.reached { Twist::stop() } else { wish };
        if ahead.blocked {
            let free_m = ahead.free_m - c.stop_distance_m;
            wish.linear = wish.linear.min(c.limits.speed_to_stop_within(free_m, c.period_s));
        }
        let order = c.limits.reachable(now, wish, c.period_s);
        self.pending.push(order);
        Following { motion: order, projection, left_m, ahead, reached: self.reached, blocked }
    }

    /// The reference at each step, at a speed that curves and the goal allow.
    fn targets(&self, path: &ReferencePath, around: &Surroundings, now: Twist) -> Vec<Target> {
        let c = &self.config;
        let frame = around.field.frame();
        let turn = frame.world_from_grid().inverse().rotation;
        let (mut along_m, mut speed) = (self.along_m, now.linear.max(0.0));
        let target = |along_m: f64| {
            let (point, direction) = path.at(along_m);
            let (p, d) = (frame.in_cells(point), turn * direction);
            Target { x: p.x as f32, y: p.y as f32, dx: d.x as f32, dy: d.y as f32 }
        };
        let mut targets = Vec::with_capacity(c.steps);
        for _ in 0..c.steps {
            let in_curve = |ahead_m: f64| {
                let k = path.curvature(along_m + ahead_m, 0.3).abs().max(1e-6);
                let there = (c.lateral_acceleration / k).sqrt().min(0.9 * c.limits.angular / k);
                (there * there + c.limits.deceleration * ahead_m).sqrt()
            };
            let curve = in_curve(0.0).min(in_curve(0.3)).min(in_curve(0.6)).max(0.2);
            let left_m = (path.length_m() - along_m).max(0.0);
            let goal = (c.limits.deceleration * left_m).sqrt();
            let wish = c.limits.linear.min(curve).min(goal);
            let (down, up) = (c.limits.deceleration * c.period_s, c.limits.acceleration * c.period_s);
            speed += (wish - speed).clamp(-down, up);
            along_m = (along_m + speed * c.period_s).min(path.length_m());
            targets.push(target(along_m));
        }
        targets
    }

    /// Rolls out all variants and stores their costs.
    fn roll_out(&mut self, pose: &Se2, now: Twist, targets: &[Target], around: &Surroundings) {
        let (c, n) = (self.config, self.config.rollouts);
        let frame = around.field.frame();
        let start = frame.in_cells(pose.translation);
        let heading = frame.world_from_grid().inverse().rotation * pose.rotation;
        let r = &mut self.rollouts;
        let fill = |v: &mut Vec<f32>, value: f64| {
            v.clear();
            v.resize(n, value as f32);
        };
        fill(&mut r.x, start.x);
        fill(&mut r.y, start.y);
        fill(&mut r.cos, heading.cos());
        fill(&mut r.sin, heading.sin());
        fill(&mut r.linear, now.linear);
        fill(&mut r.angular, now.angular);
        fill(&mut r.cost, 0.0);
        let per_cell = frame.resolution_m() as f32;
        for (t, (target, plan)) in targets.iter().zip(&self.plan).enumerate() {
            let (done, rest) = self.linear_noise.split_at_mut(t * n);
            let before = done.len().checked_sub(n).map(|from| &done[from..]);
            draw(&self.noise, &mut self.random, before, &mut rest[..n]);
            let linear_noise = &rest[..n];
            let (done, rest) = self.angular_noise.split_at_mut(t * n);
            let before = done.len().checked_sub(n).map(|from| &done[from..]);
            draw(&self.noise, &mut self.random, before, &mut rest[..n]);
            advance(r, plan, [linear_noise, &rest[..n]], &c, per_cell);
            leave_path(r, target, &c, per_cell);
            touch(r, around, &c);
            if let Some(moving) = around.moving {
                let ahead_s = (t + 1) as f64 * c.period_s + c.delay_s;
                for i in 0..n {
                    let at = Vec2::new(f64::from(r.x[i]), f64::from(r.y[i])) * frame.resolution_m();
                    let clear = moving.clearance_m(frame.world_from_grid() * at, ahead_s) - around.radius_m;
                    r.cost[i] += if clear < c.stop_distance_m { c.touch as f32 } else { 0.0 };
                }
            }
        }
    }

    /// Moves the plan to the weighted mean of the variants.
    fn improve(&mut self) {
        let (c, n) = (self.config, self.config.rollouts);
        let least = self.rollouts.cost.iter().copied().fold(f32::INFINITY, f32::min);
        let rate = 1.0 / c.temperature.max(1e-9) as f32;
        let weights: Vec<f32> = self.rollouts.cost.iter().map(|&s| (-(s - least) * rate).exp()).collect();
        let sum: f32 = weights.iter().sum();
        let mean =
            |noise: &[f32]| f64::from(noise.iter().zip(&weights).map(|(e, w)| e * w).sum::<f32>() / sum);
        for (t, plan) in self.plan.iter_mut().enumerate() {
            let steps = t * n..(t + 1) * n;
            let linear = plan.linear + c.noise.0 * mean(&self.linear_noise[steps.clone()]);
            let angular = plan.angular + c.noise.1 * mean(&self.angular_noise[steps]);
            plan.linear = linear.clamp(0.0, c.limits.linear);
            plan.angular = angular.clamp(-c.limits.angular, c.limits.angular);
        }
    }
}

/// Noise of one step, correlated with that of the step before. The first roll-out gets none: it is the plan itself.
fn draw(table: &[f32], random: &mut Random, before: Option<&[f32]>, noise: &mut [f32]) {
    let from = random.below(table.len() - noise.len());
    let fresh = &table[from..from + noise.len()];
    match before {
        Some(before) => {
            let part = (1.0 - KEEP * KEEP).sqrt();
            noise.iter_mut().zip(before).zip(fresh).for_each(|((e, b), f)| *e = KEEP * b + part * f);
        }
        None => noise.copy_from_slice(fresh),
    }
    if let Some(first) = noise.first_mut() {
        *first = 0.0;
    }
}

/// Advances all bodies by one step, within their limits.
fn advance(r: &mut Rollouts, plan: &Twist, noise: [&[f32]; 2], c: &MppiConfig, per_cell: f32) {
    let dt = c.period_s as f32;
    let (linear, angular) = (plan.linear as f32, plan.angular as f32);
    let (sigma_linear, sigma_angular) = (c.noise.0 as f32, c.noise.1 as f32);
    let (most, most_turn) = (c.limits.linear as f32, c.limits.angular as f32);
    let (up, down) = (c.limits.acceleration as f32 * dt, c.limits.deceleration as f32 * dt);
    let turn = c.limits.angular_acceleration as f32 * dt;
    let per_step = dt / per_cell;
    let n = r.x.len();
    let (x, y, cos, sin) = (&mut r.x[..n], &mut r.y[..n], &mut r.cos[..n], &mut r.sin[..n]);
    let (v, w) = (&mut r.linear[..n], &mut r.angular[..n]);
    let (ev, ew) = (&noise[0][..n], &noise[1][..n]);
    for i in 0..n {
        let wish = (linear + sigma_linear * ev[i]).max(0.0).min(most);
        let wish_turn = (angular + sigma_angular * ew[i]).max(-most_turn).min(most_turn);
        v[i] += (wish - v[i]).max(-down).min(up);
        w[i] += (wish_turn - w[i]).max(-turn).min(turn);
        // Half the turn, then the distance, then the other half of the turn.
        let h = 0.5 * dt * w[i];
        let (s, k) = (h - h * h * h / 6.0, 1.0 - 0.5 * h * h);
        let (mid_cos, mid_sin) = (cos[i] * k - sin[i] * s, sin[i] * k + cos[i] * s);
        x[i] += v[i] * per_step * mid_cos;
        y[i] += v[i] * per_step * mid_sin;
        cos[i] = mid_cos * k - mid_sin * s;
        sin[i] = mid_sin * k + mid_cos * s;
    }
}

/// Costs of lateral offset, of lag or lead along the path, and of a wrong heading.
fn leave_path(r: &mut Rollouts, target: &Target, c: &MppiConfig, per_cell: f32) {
    let square = per_cell * per_cell;
    let (lateral, lag, heading) = (c.lateral as f32 * square, c.lag as f32 * square, c.heading as f32);
    let n = r.x.len();
    let (x, y, cos, sin) = (&r.x[..n], &r.y[..n], &r.cos[..n], &r.sin[..n]);
    let cost = &mut r.cost[..n];
    for i in 0..n {
        let (ox, oy) = (x[i] - target.x, y[i] - target.y);
        let (along, beside) = (ox * target.dx + oy * target.dy, oy * target.dx - ox * target.dy);
        let facing = 1.0 - cos[i] * target.dx - sin[i] * target.dy;
        cost[i] += lateral * beside * beside + lag * along * along + heading * facing;
    }
}

/// Costs of touching a wall, and of being near one.
fn touch(r: &mut Rollouts, around: &Surroundings, c: &MppiConfig) {
    let frame = around.field.frame();
    let (width, height, per_cell) = (frame.width(), frame.height(), frame.resolution_m() as f32);
    let squared = around.field.squared();
    let radius = around.radius_m as f32;
    let far = ((around.radius_m + c.near_m) / frame.resolution_m()).powi(2) as u32;
    let (touch, near) = (c.touch as f32, c.near_m.max(1e-6) as f32);
    for ((&x, &y), cost) in r.x.iter().zip(&r.y).zip(&mut r.cost) {
        // Outside, and for NaN, nothing is free: a window of a map may end on open ground.
        let inside = x >= 0.0 && y >= 0.0 && (x as usize) < width && (y as usize) < height;
        let distance = if inside { squared[y as usize * width + x as usize] } else { 0 };
        if distance <= far {
            let clear = (distance as f32).sqrt() * per_cell - radius;
            *cost += if clear < -1e-4 { touch } else { 0.5 * (1.0 - clear / near) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::DistanceField;
    use crate::grid::{Grid, GridFrame};

    #[test]
    fn a_body_without_valid_limits_stands() {
        let frame = GridFrame::new(40, 30, 0.05, Se2::identity()).unwrap();
        let field = DistanceField::new(&Grid::filled(frame, false));
        let around = Surroundings { field: &field, moving: None, radius_m: 0.2 };
        let path = ReferencePath::new(&[Vec2::new(0.5, 0.7), Vec2::new(1.5, 0.7)]).unwrap();
        let at = Se2::from_xy_angle(0.5, 0.7, 0.0);
        let step = |limits: Limits| {
            let mut mppi = Mppi::new(MppiConfig::new(limits));
            (0..3).map(|_| mppi.step(&at, Twist::stop(), &path, &around).motion).last().unwrap()
        };
        assert!(step(Limits::differential_drive()).linear > 0.0);
        for bad in [f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(step(Limits { linear: bad, ..Limits::differential_drive() }), Twist::stop(), "{bad}");
            assert_eq!(
                step(Limits { acceleration: bad, ..Limits::differential_drive() }),
                Twist::stop(),
                "{bad}"
            );
        }
    }

    #[test]
    fn beyond_every_side_of_a_window_nothing_is_free() {
        let frame = GridFrame::new(40, 30, 0.05, Se2::identity()).unwrap();
        let field = DistanceField::new(&Grid::filled(frame, false));
        let around = Surroundings { field: &field, moving: None, radius_m: 0.2 };
        let c = MppiConfig::new(Limits::differential_drive());
        let at = [(20.0, 15.0), (-0.5, 15.0), (20.0, -0.5), (40.5, 15.0), (20.0, 30.5), (f32::NAN, 15.0)];
        let (x, y) = at.into_iter().unzip();
        let mut r = Rollouts { x, y, cost: vec![0.0; at.len()], ..Rollouts::default() };
        touch(&mut r, &around, &c);
        assert_eq!(r.cost[0], 0.0, "the middle is free");
        assert!(r.cost[1..].iter().all(|&cost| cost == c.touch as f32), "{:?}", r.cost);
    }
}
