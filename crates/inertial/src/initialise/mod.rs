//! IMU initialisation: scale, gravity, biases and velocities of a visual map from the IMU readings of the same time. It is a
//! hypothesis tested beside the map, which changes nothing until it is accepted.
//!
//! Source: Campos, Montiel, Tardós, "Inertial-only optimization for visual-inertial initialization" (ICRA 2020): the
//! maximum a posteriori over (scale, gravity's direction, biases, velocities) of eq. 3-7 with the updates of eq. 8-12. Unlike
//! there, the visual poses are not taken as exact: each has an error with a prior that the caller states, which is
//! solved for too. First guesses after Mur-Artal & Tardós, "Visual-inertial monocular SLAM with map reuse" (RA-L 2017),
//! section IV.
//!
//! Every test is a [`Gate`] with its number, so that a waiting user can be told what is missing.

mod chain;
mod gates;
mod guess;
mod map;

use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::Stamp;
pub use gates::{Gate, GateKind};
use nalgebra::SMatrix;

/// A visual pose of a key frame, in the map's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPose {
    /// Its time.
    pub stamp: Stamp,
    /// Pose of the camera.
    pub world_from_camera: Se3,
}

/// The key frames of a map, and how good their poses are.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// In time order.
    pub poses: &'a [SeenPose],
    /// Standard deviation of a rotation, rad.
    pub rotation_sigma: f64,
    /// Standard deviation of a position, in the map's units: about the median depth times the error in pixels over the focal
    /// length, less with many points observed.
    pub position_sigma: f64,
}

/// What is known of the map's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// One camera: nothing.
    Free,
    /// Stereo, depth, or an earlier estimate: metres, up to this standard deviation of the scale's logarithm.
    Known {
        /// Relative standard deviation.
        sigma: f64,
    },
}

/// Settings of the solver and bounds of the tests.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InitialiseConfig {
    /// Prior of the gyroscope's bias around zero, rad/s.
    pub gyro_bias_sigma: f64,
    /// Prior of the accelerometer's bias around zero, m/s^2.
    pub accel_bias_sigma: f64,
    /// Prior of what is left of the offset between the clocks of IMU and camera, around zero, seconds; 0 where they are known to
    /// agree.
    pub offset_sigma_s: f64,
    /// Least factor on the noise densities of the IMU: real ones are worse than their data sheets. It is raised to fit the
    /// residuals.
    pub noise_times: f64,
    /// Greatest such factor, for gyroscope and accelerometer.
    pub most_noise_times: [f64; 2],
    /// Maximum number of solver steps.
    pub iterations: usize,
    /// Minimum number of key frames.
    pub least_key_frames: usize,
    /// Minimum time from the first key frame to the last, seconds.
    pub least_seconds: f64,
    /// Minimum root mean square of the acceleration around its mean, m/s^2; only where scale is free.
    pub least_excitation: f64,
    /// Minimum spread of the camera's positions, in standard deviations of a position; only where scale is free.
    pub least_baseline: f64,
    /// Maximum weighted squared residual per degree of freedom.
    pub most_residual: f64,
    /// Maximum difference of gravity's norm, when estimated, from 9.81, beyond twice its standard deviation, m/s^2.
    pub most_gravity_off: f64,
    /// Maximum relative standard deviation of the scale.
    pub most_scale_sigma: f64,
    /// Maximum standard deviation of gravity's direction, rad.
    pub most_gravity_sigma: f64,
    /// Maximum norm of the gyro bias, rad/s.
    pub most_gyro_bias: f64,
    /// Maximum norm of the accel bias, m/s^2.
    pub most_accel_bias: f64,
}

impl Default for InitialiseConfig {
    fn default() -> Self {
        Self {
            gyro_bias_sigma: 0.1,
            accel_bias_sigma: 0.2,
            offset_sigma_s: 0.0,
            noise_times: 5.0,
            most_noise_times: [30.0, 60.0],
            iterations: 20,
            least_key_frames: 5,
            least_seconds: 1.5,
            least_excitation: 0.2,
            least_baseline: 10.0,
            most_residual: 4.0,
            most_gravity_off: 0.5,
            most_scale_sigma: 0.03,
            most_gravity_sigma: 0.035,
            most_gyro_bias: 0.3,
            most_accel_bias: 1.0,
        }
    }
}

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
    /// Per key frame the state in the frame of the map in metres (scaled about its origin, not yet gravity-aligned).
    pub states: Vec<NavState>,
    /// Of (log scale, gravity's tilt (2), gyro bias (3), accel bias (3)).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Weighted squared residual per degree of freedom; the covariance is multiplied by it, but by no less than a quarter.
    pub residual: f64,
    /// Estimated factor of the white noise of gyroscope and accelerometer over their data sheets.
    pub noise_times: [f64; 2],
    /// The fitted standard deviation of a visual position, in the map's units: that of [`Seen`], or less.
    pub position_sigma: f64,
}

impl Initial {
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

/// An attempt: its tests, and the estimate where there is one.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// All tests with their numbers, passed and failed.
    pub gates: Vec<Gate>,
    /// The estimate, accepted or not.
    pub found: Option<Initial>,
}

impl Attempt {
    /// The estimate, when every test was passed.
    pub fn accepted(&self) -> Option<&Initial> {
        self.found.as_ref().filter(|_| self.gates.iter().all(|g| g.passed))
    }

    /// The failed tests.
    pub fn failed(&self) -> impl Iterator<Item = &Gate> {
        self.gates.iter().filter(|g| !g.passed)
    }
}

/// Attempts to estimate scale, gravity and biases. `links[k]` preintegrates the readings from key frame `k` to `k + 1`;
/// `imu_from_camera` is in metres.
pub fn initialise(
    seen: &Seen,
    links: &[Preintegrated],
    imu_from_camera: &Se3,
    scale: Scale,
    config: &InitialiseConfig,
) -> Attempt {
    let mut gates = gates::before(seen, links, imu_from_camera, scale, config);
    if gates.iter().any(|g| !g.passed && g.kind.is_structural()) {
        return Attempt { gates, found: None };
    }
    let found = map::Problem::new(seen, links, imu_from_camera, scale, config).solve();
    gates.push(gates::converged(found.is_some()));
    if let Some(found) = &found {
        gates.extend(gates::after(found, scale, config));
    }
    Attempt { gates, found }
}
