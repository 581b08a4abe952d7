//! Motion models: they convert a control and its noise, in control space, to a relative motion with its covariance.
//!
//! Source: Thrun, Burgard, Fox, "Probabilistic robotics" (2005), 5.3 (velocity); Siegwart,
//! Nourbakhsh, Scaramuzza, "Introduction to autonomous mobile robots" (2011), 5.2.4 (differential drive). Each model's
//! covariance is `V M V^T`, where `M` is the covariance of the control and `V` the derivative of the motion with
//! respect to the control.

use cairn_geometry::Se2;
use nalgebra::{Matrix2, Matrix3, Matrix3x2};

/// A relative motion, with the covariance of its coordinates (x, y in metres, angle in radians) in the frame before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// The body's frame after the motion, expressed in its frame before.
    pub before_from_after: Se2,
    /// Covariance of x, y and angle of that transform.
    pub covariance: Matrix3<f64>,
}

impl Motion {
    /// No motion, with zero covariance.
    pub fn identity() -> Self {
        Self { before_from_after: Se2::identity(), covariance: Matrix3::zeros() }
    }

    /// This motion followed by another, combined; their noises are independent.
    pub fn then(&self, next: &Motion) -> Motion {
        let (r, t) = (self.before_from_after.rotation, next.before_from_after.translation);
        let (c, s) = (r.cos(), r.sin());
        let by_first = Matrix3::new(1.0, 0.0, -s * t.x - c * t.y, 0.0, 1.0, c * t.x - s * t.y, 0.0, 0.0, 1.0);
        let by_next = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        Motion {
            before_from_after: self.before_from_after * next.before_from_after,
            covariance: by_first * self.covariance * by_first.transpose()
                + by_next * next.covariance * by_next.transpose(),
        }
    }

    /// True when every number is finite and no variance is negative.
    pub fn is_valid(&self) -> bool {
        let t = &self.before_from_after;
        [t.translation.x, t.translation.y, t.rotation.cos(), t.rotation.sin()].iter().all(|v| v.is_finite())
            && self.covariance.iter().all(|v| v.is_finite())
            && self.covariance.diagonal().iter().all(|v| *v >= 0.0)
    }
}

/// Noise of forward and angular velocity as spectral densities, so that it does not depend on the length of the time
/// steps.
///
/// The density of forward velocity is `speed^2 + speed_by_speed^2 v^2 + speed_by_turn^2 w^2` in m^2/s, that of angular
/// velocity likewise in rad^2/s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VelocityModel {
    /// Forward velocity, constant part, in m/s/sqrt(Hz).
    pub speed: f64,
    /// Forward velocity, for each m/s of forward velocity, in 1/sqrt(Hz).
    pub speed_by_speed: f64,
    /// Forward velocity, for each rad/s of angular velocity, in m/rad/sqrt(Hz).
    pub speed_by_turn: f64,
    /// Angular velocity, constant part, in rad/s/sqrt(Hz).
    pub turn: f64,
    /// Angular velocity, for each m/s of forward velocity, in rad/m/sqrt(Hz).
    pub turn_by_speed: f64,
    /// Angular velocity, for each rad/s of angular velocity, in 1/sqrt(Hz).
    pub turn_by_turn: f64,
}

impl VelocityModel {
    /// Motion along an arc at constant forward (m/s) and angular (rad/s) velocity.
    pub fn motion(&self, speed_m_s: f64, turn_rad_s: f64, duration_s: f64) -> Motion {
        let (v2, w2, square) = (speed_m_s * speed_m_s, turn_rad_s * turn_rad_s, |s: f64| s * s);
        let forward = square(self.speed) + square(self.speed_by_speed) * v2 + square(self.speed_by_turn) * w2;
        let turning = square(self.turn) + square(self.turn_by_speed) * v2 + square(self.turn_by_turn) * w2;
        // White noise over the duration: the variance of the travelled distance grows with time.
        let control = Matrix2::new(forward, 0.0, 0.0, turning) * duration_s.max(0.0);
        along_arc(speed_m_s * duration_s, turn_rad_s * duration_s, &control)
    }
}

/// Differential drive: the variance of each wheel's travel grows with the distance that it rolled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DifferentialDrive {
    /// Distance between the wheels in metres.
    pub track_m: f64,
    /// Variance of the left wheel's travel for each metre, in m.
    pub left: f64,
    /// Variance of the right wheel's travel for each metre, in m.
    pub right: f64,
}

impl DifferentialDrive {
    /// Motion from the travel of the two wheels in metres.
    pub fn motion(&self, left_m: f64, right_m: f64) -> Motion {
        // From wheel travel to (distance, turn).
        let mix = Matrix2::new(0.5, 0.5, -1.0 / self.track_m, 1.0 / self.track_m);
        let wheels = Matrix2::new(self.left * left_m.abs(), 0.0, 0.0, self.right * right_m.abs());
        let control = mix * wheels * mix.transpose();
        along_arc(0.5 * (left_m + right_m), (right_m - left_m) / self.track_m, &control)
    }
}

/// Motion along an arc of this length (m) and turn (rad), with the covariance of the two.
pub fn along_arc(way_m: f64, turn_rad: f64, control: &Matrix2<f64>) -> Motion {
    let ([a, b], v) = (arc(turn_rad), arc_jacobian(way_m, turn_rad));
    Motion {
        before_from_after: Se2::from_xy_angle(way_m * a, way_m * b, turn_rad),
        covariance: v * control * v.transpose(),
    }
}

/// `sin(t) / t` and `(1 - cos(t)) / t`.
fn arc(t: f64) -> [f64; 2] {
    if t.abs() < 1e-4 {
        [1.0 - t * t / 6.0, 0.5 * t - t * t * t / 24.0]
    } else {
        [t.sin() / t, (1.0 - t.cos()) / t]
    }
}

fn arc_jacobian(way: f64, t: f64) -> Matrix3x2<f64> {
    let [a, b] = arc(t);
    let [da, db] =
        if t.abs() < 1e-4 { [-t / 3.0, 0.5 - t * t / 8.0] } else { [(t.cos() - a) / t, (t.sin() - b) / t] };
    Matrix3x2::new(a, way * da, b, way * db, 0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::wrap;
    use nalgebra::Vector3;

    fn coordinates(m: &Se2) -> Vector3<f64> {
        Vector3::new(m.translation.x, m.translation.y, m.rotation.log())
    }

    fn difference(a: &Se2, b: &Se2, h: f64) -> Vector3<f64> {
        let mut d = coordinates(a) - coordinates(b);
        d.z = wrap(d.z);
        d / (2.0 * h)
    }

    #[test]
    fn arcs_have_the_derivative_of_differences() {
        let h = 1e-6;
        let none = Matrix2::zeros();
        for (way, turn) in [(0.7, 0.0), (0.7, 1e-5), (-0.4, 0.3), (2.0, -3.0), (0.0, 1.0), (1.0, 3.1)] {
            let at = |w: f64, t: f64| along_arc(w, t, &none).before_from_after;
            let v = arc_jacobian(way, turn);
            let by_way = difference(&at(way + h, turn), &at(way - h, turn), h);
            let by_turn = difference(&at(way, turn + h), &at(way, turn - h), h);
            assert!((v.column(0) - by_way).norm() < 1e-7, "{way} {turn}");
            assert!((v.column(1) - by_turn).norm() < 1e-7, "{way} {turn}");
        }
    }

    #[test]
    fn composing_has_the_derivative_of_differences() {
        let first =
            Motion { before_from_after: Se2::from_xy_angle(0.5, -0.2, 2.0), covariance: Matrix3::identity() };
        let next =
            Motion { before_from_after: Se2::from_xy_angle(0.3, 0.8, 2.5), covariance: Matrix3::zeros() };
        let h = 1e-6;
        let moved = |m: &Se2, d: Vector3<f64>| {
            Se2::from_xy_angle(m.translation.x + d.x, m.translation.y + d.y, m.rotation.log() + d.z)
        };
        for (one, two) in [
            (first, next),
            (
                Motion { covariance: Matrix3::zeros(), ..first },
                Motion { covariance: Matrix3::identity(), ..next },
            ),
        ] {
            let mut j = Matrix3::zeros();
            for k in 0..3 {
                let d = Vector3::from_fn(|r, _| if r == k { h } else { 0.0 });
                let at = |d: Vector3<f64>| {
                    if one.covariance.norm() > 0.0 {
                        moved(&one.before_from_after, d) * two.before_from_after
                    } else {
                        one.before_from_after * moved(&two.before_from_after, d)
                    }
                };
                j.set_column(k, &difference(&at(d), &at(-d), h));
            }
            assert!((one.then(&two).covariance - j * j.transpose()).norm() < 1e-6);
        }
    }

    #[test]
    fn noise_does_not_depend_on_how_time_is_cut() {
        let model = VelocityModel {
            speed: 0.05,
            speed_by_speed: 0.1,
            speed_by_turn: 0.02,
            turn: 0.03,
            turn_by_speed: 0.1,
            turn_by_turn: 0.2,
        };
        let whole = model.motion(0.3, 0.4, 1.0);
        let parts = (0..500).fold(Motion::identity(), |m, _| m.then(&model.motion(0.3, 0.4, 1.0 / 500.0)));
        assert!(
            (coordinates(&whole.before_from_after) - coordinates(&parts.before_from_after)).norm() < 1e-9
        );
        // One control for the whole second adds the noise at another linearisation point: equal to second order.
        let scale = whole.covariance.norm();
        assert!((whole.covariance - parts.covariance).norm() < 0.3 * scale);
        assert!((whole.covariance[(2, 2)] - parts.covariance[(2, 2)]).abs() < 1e-12);
    }

    #[test]
    fn wheels_turn_as_their_difference() {
        let drive = DifferentialDrive { track_m: 0.4, left: 1e-3, right: 1e-3 };
        let spin = drive.motion(-0.1, 0.1);
        assert!(spin.before_from_after.translation.norm() < 1e-15);
        assert!((spin.before_from_after.rotation.log() - 0.5).abs() < 1e-12);
        assert!((spin.covariance[(2, 2)] - 2e-4 / 0.16).abs() < 1e-12);
        assert!(spin.is_valid() && !drive.motion(f64::NAN, 0.0).is_valid());
    }
}
