//! The state of an IMU: biases, pose, velocity; and gravity.

use cairn_geometry::{Manifold, Mat3, Se3, So3, Vec3};
use cairn_sensor::GRAVITY_M_S2;
use nalgebra::{Matrix3x2, SVector, Vector2};

/// The biases of an IMU, to be subtracted from its readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Bias {
    /// Of the gyroscope, rad/s.
    pub gyro: Vec3,
    /// Of the accelerometer, m/s^2.
    pub accel: Vec3,
}

/// The state of an inertial sensor at one instant. Its tangent is (translation, rotation, velocity, gyro bias, accel
/// bias), the pose perturbed on the right, all else added.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NavState {
    /// Its pose, metres.
    pub world_from_imu: Se3,
    /// Its velocity, m/s in the world.
    pub velocity: Vec3,
    /// Its biases.
    pub bias: Bias,
}

impl NavState {
    /// At rest at the origin, without bias.
    pub fn identity() -> Self {
        Self { world_from_imu: Se3::identity(), velocity: Vec3::zeros(), bias: Bias::default() }
    }
}

impl Manifold<15> for NavState {
    fn retract(&self, d: &SVector<f64, 15>) -> Self {
        let part = |i: usize| -> Vec3 { d.fixed_rows::<3>(i).into() };
        Self {
            world_from_imu: self.world_from_imu.retract(&d.fixed_rows::<6>(0).into()),
            velocity: self.velocity + part(6),
            bias: Bias { gyro: self.bias.gyro + part(9), accel: self.bias.accel + part(12) },
        }
    }

    fn local(&self, other: &Self) -> SVector<f64, 15> {
        let mut d = SVector::<f64, 15>::zeros();
        d.fixed_rows_mut::<6>(0).copy_from(&self.world_from_imu.local(&other.world_from_imu));
        d.fixed_rows_mut::<3>(6).copy_from(&(other.velocity - self.velocity));
        d.fixed_rows_mut::<3>(9).copy_from(&(other.bias.gyro - self.bias.gyro));
        d.fixed_rows_mut::<3>(12).copy_from(&(other.bias.accel - self.bias.accel));
        d
    }
}

/// Gravity in a world with any axes: a direction on the sphere and a known magnitude.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gravity {
    /// Rotation from a frame with z up (its rotation about z has no meaning).
    pub world_from_level: So3,
    /// Magnitude, m/s^2.
    pub magnitude: f64,
}

impl Gravity {
    /// Gravity along -z of the world.
    pub fn level() -> Self {
        Self { world_from_level: So3::identity(), magnitude: GRAVITY_M_S2 }
    }

    /// Gravity along a vector that need not have its length; `None` when that is zero or not finite.
    pub fn along(direction: &Vec3, magnitude: f64) -> Option<Self> {
        let up = -direction.try_normalize(1e-9).filter(|d| d.iter().all(|v| v.is_finite()))?;
        let axis = Vec3::z().cross(&up);
        let angle = axis.norm().atan2(up.z);
        // Straight down: any horizontal axis will do.
        let axis = axis.try_normalize(1e-12).unwrap_or_else(Vec3::x);
        Some(Self { world_from_level: So3::exp(&(axis * angle)), magnitude })
    }

    /// The acceleration of free fall in the world, m/s^2.
    pub fn vector(&self) -> Vec3 {
        self.world_from_level * Vec3::new(0.0, 0.0, -self.magnitude)
    }

    /// The derivative of [`Gravity::vector`] by [`Gravity::retract`]'s argument.
    pub fn jacobian(&self) -> Matrix3x2<f64> {
        let r: Mat3 = self.world_from_level.matrix() * self.magnitude;
        Matrix3x2::from_columns(&[r.column(1).into_owned(), -r.column(0)])
    }
}

impl Manifold<2> for Gravity {
    /// Tilts about the level frame's x and y.
    fn retract(&self, d: &Vector2<f64>) -> Self {
        Self {
            world_from_level: self.world_from_level * So3::exp(&Vec3::new(d.x, d.y, 0.0)),
            magnitude: self.magnitude,
        }
    }

    fn local(&self, other: &Self) -> Vector2<f64> {
        let up = self.world_from_level.inverse() * (-other.vector() / other.magnitude);
        let axis = Vec3::z().cross(&up);
        let (sine, angle) = (axis.norm(), axis.norm().atan2(up.z));
        if sine < 1e-12 { Vector2::zeros() } else { Vector2::new(axis.x, axis.y) * (angle / sine) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gravity_keeps_the_manifold_contract() {
        let g = Gravity::along(&Vec3::new(1.0, -2.0, -7.0), 9.8).unwrap();
        assert!((g.vector() - Vec3::new(1.0, -2.0, -7.0).normalize() * 9.8).norm() < 1e-12);
        let d = Vector2::new(0.3, -0.2);
        assert!((g.local(&g.retract(&d)) - d).norm() < 1e-12);
        let other = Gravity::along(&Vec3::new(-3.0, 0.1, 2.0), 9.8).unwrap();
        assert!((g.retract(&g.local(&other)).vector() - other.vector()).norm() < 1e-9);
        for k in 0..2 {
            let mut d = Vector2::zeros();
            d[k] = 1e-6;
            let numeric = (g.retract(&d).vector() - g.retract(&-d).vector()) / 2e-6;
            assert!((numeric - g.jacobian().column(k)).norm() < 1e-7);
        }
        let down = Gravity::along(&Vec3::z(), 9.8).unwrap();
        assert!((down.vector() - Vec3::z() * 9.8).norm() < 1e-12);
        assert!(Gravity::along(&Vec3::zeros(), 9.8).is_none());
    }
}
