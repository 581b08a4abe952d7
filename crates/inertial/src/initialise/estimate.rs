//! What an initialisation finds.

use crate::{Bias, Gravity, NavState};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use nalgebra::SMatrix;

/// The estimate.
#[derive(Clone, Debug)]
pub struct Initial {
    /// Metres in a unit of the map.
    pub scale: f64,
    /// Standard deviation of the scale's logarithm.
    pub scale_sigma: f64,
    /// Gravity in the frame of the map.
    pub gravity: Gravity,
    /// Standard deviation of its direction, rad (the greater of two axes).
    pub gravity_sigma: f64,
    /// Gravity's norm when it is estimated too, and its standard deviation, m/s^2.
    pub gravity_norm: [f64; 2],
    /// The biases, constant over the key frames.
    pub bias: Bias,
    /// Seconds to add to the samples' stamps to get the poses' clock, beyond what was added already.
    pub offset_s: f64,
    /// Its standard deviation.
    pub offset_sigma_s: f64,
    /// Where the camera is on the IMU, metres.
    pub lever_arm: Vec3,
    /// Per key frame the state in the frame of the map in metres (scaled about its origin, not yet gravity-aligned).
    pub states: Vec<NavState>,
    /// Of (log scale, gravity's tilt (2), gyro bias (3), accel bias (3)); of the biases at the newest key frame.
    pub covariance: SMatrix<f64, 9, 9>,
    /// The part of it that white noise of readings and poses explains; the rest is of the accelerometer's sensitivity and of the biases'
    /// random walk.
    pub noise_covariance: SMatrix<f64, 9, 9>,
    /// Weighted squared residual per degree of freedom; the part of white noise is multiplied by it, but by no less than a quarter.
    pub residual: f64,
    /// Estimated factor of the white noise of gyroscope and accelerometer over their data sheets.
    pub noise_times: [f64; 2],
    /// The fitted standard deviation of a visual position, in the map's units: that of [`Seen`](super::Seen), or less.
    pub position_sigma: f64,
}

impl Initial {
    /// Standard deviation of gravity's direction by white noise alone, rad (the greater of two axes).
    pub fn gravity_noise_sigma(&self) -> f64 {
        tilt_sigma(&self.noise_covariance)
    }

    /// From the frame of the map into a gravity-aligned one in metres with z up; the map's origin stays where it is.
    pub fn metric_from_map(&self) -> Sim3 {
        Sim3 {
            rotation: self.gravity.world_from_level.inverse(),
            translation: Vec3::zeros(),
            scale: self.scale,
        }
    }

    /// A state in the frame of the map, transformed into that gravity-aligned one.
    pub fn level(&self, state: &NavState) -> NavState {
        let level_from_world: So3 = self.gravity.world_from_level.inverse();
        NavState {
            world_from_imu: Se3::new(level_from_world, Vec3::zeros()) * state.world_from_imu,
            velocity: level_from_world * state.velocity,
            bias: state.bias,
        }
    }
}

/// Standard deviation of gravity's direction in a covariance, rad (the greater of two axes).
pub(super) fn tilt_sigma(covariance: &SMatrix<f64, 9, 9>) -> f64 {
    let tilt: SMatrix<f64, 2, 2> = covariance.fixed_view::<2, 2>(1, 1).into();
    tilt.symmetric_eigenvalues().max().max(0.0).sqrt()
}
