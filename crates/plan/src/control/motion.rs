//! Motions of a body that turns and moves along its heading, and their limits.

use cairn_geometry::{Se2, So2, Vec2};

/// Speed along the heading and yaw rate, as in ROS's `geometry_msgs/Twist`.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Forwards, in m/s.
    pub linear: f64,
    /// Counter-clockwise, in rad/s.
    pub angular: f64,
}

impl Twist {
    /// From linear and angular speed.
    pub fn new(linear: f64, angular: f64) -> Self {
        Self { linear, angular }
    }

    /// Standing still.
    pub fn stop() -> Self {
        Self::default()
    }
}

/// What a body can do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Greatest forward speed, in m/s.
    pub linear: f64,
    /// Greatest backward speed, in m/s.
    pub backwards: f64,
    /// Greatest yaw rate, in rad/s.
    pub angular: f64,
    /// Greatest acceleration, in m/s^2.
    pub acceleration: f64,
    /// Greatest deceleration, in m/s^2.
    pub deceleration: f64,
    /// Greatest angular acceleration, in rad/s^2.
    pub angular_acceleration: f64,
}

/// Limits with a value that is not a positive number.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("limits of speed and acceleration are positive finite numbers (backwards may be 0)")]
pub struct LimitsError;

impl Limits {
    /// Those of a body that does not move.
    pub(super) fn standing() -> Self {
        Self { linear: 0.0, backwards: 0.0, angular: 0.0, ..Self::differential_drive() }
    }

    /// A small robot with differential drive.
    pub fn differential_drive() -> Self {
        Self {
            linear: 1.0,
            backwards: 0.2,
            angular: 2.0,
            acceleration: 1.0,
            deceleration: 1.5,
            angular_acceleration: 6.0,
        }
    }

    /// A person on foot who is guided: slow, and quick to stop.
    pub fn walking_pace() -> Self {
        Self {
            linear: 0.8,
            backwards: 0.3,
            angular: 1.2,
            acceleration: 0.8,
            deceleration: 1.6,
            angular_acceleration: 3.0,
        }
    }

    /// Checks that all limits are usable.
    ///
    /// # Errors
    /// When one is NaN, infinite or not positive.
    pub fn check(&self) -> Result<(), LimitsError> {
        let positive =
            [self.linear, self.angular, self.acceleration, self.deceleration, self.angular_acceleration];
        let sound = positive.iter().all(|v| v.is_finite() && *v > 0.0);
        if sound && self.backwards.is_finite() && self.backwards >= 0.0 { Ok(()) } else { Err(LimitsError) }
    }

    /// The motion nearest to `wish` that can be reached within `dt_s` from `from`. A wish that is not finite means
    /// stop; limits that are not valid, and a time that is none, stop at once.
    pub fn reachable(&self, from: Twist, wish: Twist, dt_s: f64) -> Twist {
        if self.check().is_err() || !(dt_s.is_finite() && dt_s >= 0.0) {
            return Twist::stop();
        }
        let wish = if wish.linear.is_finite() && wish.angular.is_finite() { wish } else { Twist::stop() };
        let linear = wish.linear.clamp(-self.backwards, self.linear);
        let angular = wish.angular.clamp(-self.angular, self.angular);
        // Towards zero the deceleration limit applies, away from it the acceleration limit.
        let rate =
            |from: f64, to: f64| if to.abs() < from.abs() { self.deceleration } else { self.acceleration };
        let step = rate(from.linear, linear) * dt_s;
        let turn = self.angular_acceleration * dt_s;
        Twist {
            linear: from.linear + (linear - from.linear).clamp(-step, step),
            angular: from.angular + (angular - from.angular).clamp(-turn, turn),
        }
    }

    /// The greatest speed from which a stop within `free_m` is possible when the brakes answer after `delay_s`.
    pub fn speed_to_stop_within(&self, free_m: f64, delay_s: f64) -> f64 {
        let slack = self.deceleration * delay_s;
        ((slack * slack + 2.0 * self.deceleration * free_m.max(0.0)).sqrt() - slack).max(0.0)
    }
}

/// The pose after a constant motion for `dt_s`: an exact arc.
pub fn moved(world_from_body: &Se2, motion: Twist, dt_s: f64) -> Se2 {
    let (distance, angle) = (motion.linear * dt_s, motion.angular * dt_s);
    // Chord of the arc; its direction is half of the turn.
    let half = 0.5 * angle;
    let chord = if half.abs() < 1e-6 { distance } else { distance * half.sin() / half };
    let step = Se2::new(So2::exp(angle), Vec2::new(chord * half.cos(), chord * half.sin()));
    *world_from_body * step
}
