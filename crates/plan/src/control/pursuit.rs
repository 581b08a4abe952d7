//! Regulated pure pursuit (Macenski, Singh, Martin and Gines, "Regulated Pure Pursuit for Robot Path Tracking", 2023):
//! the body drives on an arc towards a look-ahead point on the path (Coulter 1992), slower in curves, near walls and
//! before the goal. The arc and the path ahead are checked for collisions, and the speed always allows a stop at the
//! stop distance.
//!
//! Beyond the paper, the pose is predicted over the delay of the drive from the commands already given, and the corner
//! cutting that the look-ahead point causes is compensated: the arc has the curvature of the path plus that of the arc
//! that removes the remaining offset.

use super::ahead::{CollisionCheck, Surroundings};
use super::delay::PendingCommands;
use super::motion::{Limits, Twist};
use super::reference::{Progress, Projection, ReferencePath};
use cairn_geometry::Se2;

/// How a path is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PursuitConfig {
    /// Limits of the body.
    pub limits: Limits,
    /// Time between two steps, in seconds.
    pub period_s: f64,
    /// Delay from command to motion, in seconds.
    pub delay_s: f64,
    /// Look-ahead time at the current speed, in seconds; the distance is limited by `look_ahead_m`.
    pub look_ahead_s: f64,
    /// Least and greatest look-ahead distance, in metres.
    pub look_ahead_m: (f64, f64),
    /// Greatest lateral acceleration in curves, in m/s^2.
    pub lateral_acceleration: f64,
    /// Below this distance to a wall, beyond the radius, the speed falls in proportion, in metres.
    pub slow_near_m: f64,
    /// Regulation never lowers the speed below this part of the greatest speed, except to stop.
    pub least_part: f64,
    /// Distance kept between the body and an obstacle in its way, in metres.
    pub stop_distance_m: f64,
    /// The body turns in place where the direction of the path differs by more than this, in radians.
    pub turn_in_place: f64,
    /// The goal is reached within this distance, in metres.
    pub goal_tolerance_m: f64,
}

impl PursuitConfig {
    /// Defaults that suit the limits of a body.
    pub fn new(limits: Limits) -> Self {
        Self {
            limits,
            period_s: 0.05,
            delay_s: 0.05,
            look_ahead_s: 0.45,
            look_ahead_m: (0.25, 0.6),
            lateral_acceleration: 0.6,
            slow_near_m: 0.15,
            least_part: 0.3,
            stop_distance_m: 0.1,
            turn_in_place: 0.8,
            goal_tolerance_m: 0.1,
        }
    }
}

/// Result of one step of following.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Following {
    /// The motion to command.
    pub motion: Twist,
    /// Where the body is on the path.
    pub projection: Projection,
    /// Remaining length of the path in metres.
    pub left_m: f64,
    /// Result of the collision check.
    pub ahead: CollisionCheck,
    /// The goal is reached; the commanded motion is a stop.
    pub reached: bool,
    /// Something is within the stop distance; the commanded motion is a stop.
    pub blocked: bool,
}

/// Follows one path.
#[derive(Clone, Debug)]
pub struct Pursuit {
    config: PursuitConfig,
    along_m: f64,
    turning: bool,
    reached: bool,
    pending: PendingCommands,
}

impl Pursuit {
    /// At the beginning of a path.
    pub fn new(config: PursuitConfig) -> Self {
        let pending = PendingCommands::new(config.delay_s, config.period_s);
        Self { config, along_m: 0.0, turning: false, reached: false, pending }
    }

    /// The configuration.
    pub fn config(&self) -> &PursuitConfig {
        &self.config
    }

    /// Switches to another path, starting `along_m` from its beginning; earlier commands still count.
    pub fn restart(&mut self, along_m: f64) {
        (self.along_m, self.turning, self.reached) = (along_m, false, false);
    }

    /// Whether this follower should take over from another one: the direction of the path differs so much from the
    /// heading that the body turns in place, or the goal is so near that only braking is left.
    pub fn is_needed(&self, world_from_body: &Se2, path: &ReferencePath) -> bool {
        let look_m = self.config.look_ahead_m.0;
        let at = path.project(world_from_body.translation, self.along_m - 0.3, self.along_m + 1.0).along_m;
        let seen = world_from_body.inverse() * path.at(at + look_m).0;
        let last = path.length_m() - at < self.config.look_ahead_m.1;
        last || self.turning || seen.y.atan2(seen.x).abs() > self.config.turn_in_place
    }

    /// Records a command that came from elsewhere, a recovery for instance.
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
        let look_m = (now.linear.abs() * c.look_ahead_s).min(c.look_ahead_m.1).max(c.look_ahead_m.0);
        let (point, direction) = path.at(projection.along_m + look_m.min(left_m));
        // Beyond the end, the look-ahead point continues straight, so that the arc stays well defined.
        let point = point + direction * (look_m - left_m).max(0.0);
        let seen = pose.inverse() * point;
        let bearing = seen.y.atan2(seen.x);
        self.turning = bearing.abs() > if self.turning { 0.25 * c.turn_in_place } else { c.turn_in_place };
        let curvature = self.curvature(path, &pose, projection, look_m);
        let arc = Twist::new(1.0, curvature);
        let reach_m = (now.linear.max(0.0) + 0.3).min(left_m);
        let ahead =
            around.ahead(&pose, arc, look_m.min(left_m), Some((path, projection.along_m + look_m)), reach_m);
        let blocked = ahead.blocked && ahead.free_m <= c.stop_distance_m;
        let wish = if self.reached || (blocked && !self.turning) {
            Twist::stop()
        } else if self.turning {
            let rate =
                c.limits.angular.min((2.0 * c.limits.angular_acceleration * bearing.abs()).sqrt() * 0.7);
            Twist::new(0.0, rate * bearing.signum())
        } else {
            let speed = self.speed(path, curvature, projection, left_m, &ahead);
            Twist::new(speed, speed * curvature)
        };
        let mut order = c.limits.reachable(now, wish, c.period_s);
        if !self.turning && order.linear > 1e-3 {
            // The curvature is what keeps the body on the path: while the speed still changes, the yaw rate follows it.
            let turn = order.linear * curvature;
            order.angular = c.limits.reachable(now, Twist::new(order.linear, turn), c.period_s).angular;
        }
        self.pending.push(order);
        Following { motion: order, projection, left_m, ahead, reached: self.reached, blocked }
    }

    /// Curvature to drive at: that of the path half-way to the look-ahead point, plus what removes offset and heading
    /// error over the look-ahead distance (the chord of pure pursuit, measured relative to the path's own).
    fn curvature(&self, path: &ReferencePath, pose: &Se2, at: Projection, look_m: f64) -> f64 {
        let target = |from: &Se2| {
            let (point, direction) = path.at(at.along_m + look_m);
            let beyond = (at.along_m + look_m - path.length_m()).max(0.0);
            let seen = from.inverse() * (point + direction * beyond);
            2.0 * seen.y / seen.norm_squared().max(1e-6)
        };
        let (foot, direction) = path.at(at.along_m);
        let Some(rotation) = cairn_geometry::So2::from_cos_sin(direction.x, direction.y) else {
            return target(pose);
        };
        // The curvature that pure pursuit would command from the path itself is its error in curves.
        let on_path = target(&Se2::new(rotation, foot));
        let own = path.curvature(at.along_m, 0.3);
        target(pose) - on_path + own
    }

    /// The regulated speed.
    fn speed(
        &self,
        path: &ReferencePath,
        curvature: f64,
        at: Projection,
        left_m: f64,
        ahead: &CollisionCheck,
    ) -> f64 {
        let c = &self.config;
        let least = c.least_part * c.limits.linear;
        let in_curve = |k: f64| {
            (c.lateral_acceleration / k.abs().max(1e-6))
                .sqrt()
                .min(0.9 * c.limits.angular / k.abs().max(1e-6))
        };
        // Slows down in time for curves ahead.
        let mut speed = c.limits.linear.min(in_curve(curvature).max(least));
        for k in 1..=12 {
            let ahead_m = 0.1 * f64::from(k);
            let there = in_curve(path.curvature(at.along_m + ahead_m, 0.3)).max(least);
            speed = speed.min((there * there + 2.0 * 0.7 * c.limits.deceleration * ahead_m).sqrt());
        }
        let near = (ahead.clearance_m / c.slow_near_m).min(1.0).max(c.least_part);
        speed = speed.min(c.limits.linear * near);
        // Approaches the goal with half the deceleration, so as not to overrun it.
        let to_goal =
            (2.0 * 0.5 * c.limits.deceleration * (left_m - 0.3 * c.goal_tolerance_m).max(0.0)).sqrt();
        speed = speed.min(to_goal.max(0.05));
        if ahead.blocked {
            speed = speed.min(c.limits.speed_to_stop_within(ahead.free_m - c.stop_distance_m, c.period_s));
        }
        speed
    }
}
