//! The inertial residual between two states, with its Jacobians.
//!
//! Source: Forster et al. (TRO 2017), eq. 45 and appendix C, with the pose perturbed on the right as everywhere here
//! (a translation perturbation is along the sensor's own axes); the columns of gravity's direction and of scale after
//! Campos, Montiel, Tardos, "Inertial-only optimization for visual-inertial initialization" (ICRA 2020), eq. 8-12.

use crate::{Gravity, NavState, Preintegrated};
use cairn_geometry::{Mat3, So3, Vec3, hat};
use nalgebra::{Cholesky, SMatrix, SVector};

/// A residual over (rotation, velocity, position, gyro bias, accel bias) and its derivatives.
#[derive(Clone, Debug)]
pub struct InertialResidual {
    /// rad, m/s, m, rad/s, m/s^2; zero when the states fit the readings.
    pub residual: SVector<f64, 15>,
    /// By the first state's tangent.
    pub by_from: SMatrix<f64, 15, 15>,
    /// By the second state's tangent.
    pub by_to: SMatrix<f64, 15, 15>,
    /// By [`Gravity`]'s tangent.
    pub by_gravity: SMatrix<f64, 15, 2>,
    /// World to the first state's axes; for [`InertialResidual::by_log_scale`].
    imu_from_world: Mat3,
}

impl InertialResidual {
    /// By the logarithm of a map's scale: `shift` is what the positions' difference `second - first` gains by it, which is
    /// the scaled difference of the cameras' positions in the world, metres.
    pub fn by_log_scale(&self, shift: &Vec3) -> SVector<f64, 15> {
        let mut column = SVector::<f64, 15>::zeros();
        column.fixed_rows_mut::<3>(6).copy_from(&(self.imu_from_world * shift));
        column
    }
}

impl Preintegrated {
    /// The residual alone.
    pub fn residual(&self, from: &NavState, to: &NavState, gravity: &Gravity) -> SVector<f64, 15> {
        let (g, t) = (gravity.vector(), self.seconds());
        let (rotation, velocity, position) = self.gained(&from.bias);
        let back = from.world_from_imu.rotation.inverse();
        let moved = to.world_from_imu.translation - from.world_from_imu.translation;
        let mut r = SVector::<f64, 15>::zeros();
        let turn = (rotation.inverse() * back * to.world_from_imu.rotation).log();
        r.fixed_rows_mut::<3>(0).copy_from(&turn);
        r.fixed_rows_mut::<3>(3).copy_from(&(back * (to.velocity - from.velocity - g * t) - velocity));
        let place = back * (moved - from.velocity * t - g * (0.5 * t * t)) - position;
        r.fixed_rows_mut::<3>(6).copy_from(&place);
        r.fixed_rows_mut::<3>(9).copy_from(&(to.bias.gyro - from.bias.gyro));
        r.fixed_rows_mut::<3>(12).copy_from(&(to.bias.accel - from.bias.accel));
        r
    }

    /// The residual and its Jacobians.
    pub fn linearise(&self, from: &NavState, to: &NavState, gravity: &Gravity) -> InertialResidual {
        let residual = self.residual(from, to, gravity);
        let (s, g, t) = (self.sums(), gravity.vector(), self.seconds());
        let (r1, r2) = (from.world_from_imu.rotation.matrix(), to.world_from_imu.rotation.matrix());
        let back = r1.transpose();
        let moved = to.world_from_imu.translation - from.world_from_imu.translation;
        let turn: Vec3 = residual.fixed_rows::<3>(0).into();
        let inverse = So3::right_jacobian_inverse(&turn);
        let relative = back * r2;
        let identity = Mat3::identity();

        let mut by_from = SMatrix::<f64, 15, 15>::zeros();
        let mut by_to = SMatrix::<f64, 15, 15>::zeros();
        let set = |m: &mut SMatrix<f64, 15, 15>, row: usize, column: usize, block: Mat3| {
            m.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
        };
        // Rotation.
        let correction = s.rotation_by_gyro * (from.bias.gyro - self.bias().gyro);
        let by_gyro =
            -(inverse * So3::exp(&-turn).matrix() * So3::right_jacobian(&correction) * s.rotation_by_gyro);
        set(&mut by_from, 0, 3, -(inverse * relative.transpose()));
        set(&mut by_from, 0, 9, by_gyro);
        set(&mut by_to, 0, 3, inverse);
        // Velocity.
        let gained = back * (to.velocity - from.velocity - g * t);
        set(&mut by_from, 3, 3, hat(&gained));
        set(&mut by_from, 3, 6, -back);
        set(&mut by_from, 3, 9, -s.velocity_by_gyro);
        set(&mut by_from, 3, 12, -s.velocity_by_accel);
        set(&mut by_to, 3, 6, back);
        // Position.
        let gone = back * (moved - from.velocity * t - g * (0.5 * t * t));
        set(&mut by_from, 6, 0, -identity);
        set(&mut by_from, 6, 3, hat(&gone));
        set(&mut by_from, 6, 6, back * -t);
        set(&mut by_from, 6, 9, -s.position_by_gyro);
        set(&mut by_from, 6, 12, -s.position_by_accel);
        set(&mut by_to, 6, 0, relative);
        // Biases.
        for row in [9, 12] {
            set(&mut by_from, row, row, -identity);
            set(&mut by_to, row, row, identity);
        }
        // Gravity.
        let tilt = back * gravity.jacobian();
        let mut by_gravity = SMatrix::<f64, 15, 2>::zeros();
        by_gravity.fixed_view_mut::<3, 2>(3, 0).copy_from(&(tilt * -t));
        by_gravity.fixed_view_mut::<3, 2>(6, 0).copy_from(&(tilt * (-0.5 * t * t)));
        InertialResidual { residual, by_from, by_to, by_gravity, imu_from_world: back }
    }

    /// `W` with `W' W` the inverse of the covariance, so that `W` times a residual has unit covariance; `None` for an empty sum.
    pub fn whitening(&self) -> Option<SMatrix<f64, 15, 15>> {
        Cholesky::new(self.covariance())?.l().try_inverse()
    }

    /// The same for the motion alone (rotation, velocity, position), the biases held constant.
    pub fn motion_whitening(&self) -> Option<SMatrix<f64, 9, 9>> {
        Cholesky::new(self.motion_covariance())?.l().try_inverse()
    }
}
