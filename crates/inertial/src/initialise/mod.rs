//! Scale, gravity, biases and velocities of a map that was seen, from what the inertial sensor felt meanwhile: a
//! hypothesis that is tried beside the map and changes nothing until it is believed.
//!
//! Source: Campos, Montiel, Tardós, "Inertial-only optimization for visual-inertial initialization" (ICRA 2020): the
//! maximum a posteriori over (scale, gravity's direction, biases, velocities) of eq. 3-7 with the updates of eq. 8-12. MatchFailure
//! there the seen poses are not taken as exact: each has an error of its own with the prior that its maker states, which
//! is solved for too. First guesses after Mur-Artal & Tardós, "Visual-inertial monocular SLAM with map reuse" (RA-L 2017),
//! section IV.
//!
//! Every test is a [`Gate`] with its number, so that who waits can be told what for.

mod chain;
mod gates;
mod guess;
mod map;

use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_sensor::Stamp;
pub use gates::{Gate, GateKind};
use nalgebra::SMatrix;

/// A key frame as it was seen: in the map's own units.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SeenPose {
    /// When.
    pub stamp: Stamp,
    /// Where the eye was.
    pub world_from_camera: Se3,
}

/// The key frames of a map, and how good their poses are.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// In time order.
    pub poses: &'a [SeenPose],
    /// Standard deviation of a rotation, rad.
    pub rotation_sigma: f64,
    /// Standard deviation of a place, in the map's units: about the median depth times the error in pixels over the focal
    /// length, less as many points are seen.
    pub position_sigma: f64,
}

/// What is known of the map's scale.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scale {
    /// One camera: nothing.
    Free,
    /// Stereo, depth, or an estimate before: metres, but for this standard deviation of the scale's logarithm.
    Known {
        /// Relative standard deviation.
        sigma: f64,
    },
}

/// How it is solved, and what is asked of it.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InitialiseConfig {
    /// Prior of the gyroscope's bias around zero, rad/s.
    pub gyro_bias_sigma: f64,
    /// Prior of the accelerometer's bias around zero, m/s^2.
    pub accel_bias_sigma: f64,
    /// What to multiply the sensor's noise densities with at least: real ones are worse than their data sheets. It is raised
    /// to fit what is left over.
    pub noise_times: f64,
    /// That number at most, for gyroscope and accelerometer.
    pub most_noise_times: [f64; 2],
    /// Steps of the solver at most.
    pub iterations: usize,
    /// Key frames at least.
    pub least_key_frames: usize,
    /// Seconds from the first key frame to the last at least.
    pub least_seconds: f64,
    /// Root mean square of the acceleration around its mean at least, m/s^2; only where scale is free.
    pub least_excitation: f64,
    /// Spread of the eye's places at least, in times the standard deviation of a place; only where scale is free.
    pub least_baseline: f64,
    /// Weighted squared residuals for each degree of freedom at most.
    pub most_residual: f64,
    /// Difference of gravity's norm, left free, from 9.81 at most, m/s^2, beyond twice its standard deviation.
    pub most_gravity_off: f64,
    /// Standard deviation of the scale at most, relative.
    pub most_scale_sigma: f64,
    /// Standard deviation of gravity's direction at most, rad.
    pub most_gravity_sigma: f64,
    /// Norm of the gyroscope's bias at most, rad/s.
    pub most_gyro_bias: f64,
    /// Norm of the accelerometer's bias at most, m/s^2.
    pub most_accel_bias: f64,
}

impl Default for InitialiseConfig {
    fn default() -> Self {
        Self {
            gyro_bias_sigma: 0.1,
            accel_bias_sigma: 0.2,
            noise_times: 5.0,
            most_noise_times: [30.0, 60.0],
            iterations: 20,
            least_key_frames: 5,
            least_seconds: 1.5,
            least_excitation: 0.2,
            least_baseline: 10.0,
            most_residual: 4.0,
            most_gravity_off: 0.5,
            most_scale_sigma: 0.02,
            most_gravity_sigma: 0.035,
            most_gyro_bias: 0.3,
            most_accel_bias: 1.0,
        }
    }
}

/// What was found.
#[derive(Clone, Debug)]
pub struct Initial {
    /// Metres in a unit of the map.
    pub scale: f64,
    /// Standard deviation of the scale's logarithm.
    pub scale_sigma: f64,
    /// Gravity in the map's world.
    pub gravity: Gravity,
    /// Standard deviation of its direction, rad (the greater of two axes).
    pub gravity_sigma: f64,
    /// What gravity's norm would be if it were free, and its standard deviation, m/s^2.
    pub gravity_norm: [f64; 2],
    /// The biases, constant over the key frames.
    pub bias: Bias,
    /// Per key frame the state in the map's world in metres (scaled about its origin, not yet levelled).
    pub states: Vec<NavState>,
    /// Of (log scale, gravity's tilt (2), gyro bias (3), accel bias (3)).
    pub covariance: SMatrix<f64, 9, 9>,
    /// Weighted squared residuals for each degree of freedom; the covariance is raised by it where it is over 1.
    pub residual: f64,
    /// How many times its data sheet's the white noise of the gyroscope and of the accelerometer seems to be.
    pub noise_times: [f64; 2],
}

impl Initial {
    /// From the map's world into one in metres with z up; the map's origin stays where it is.
    pub fn metric_from_map(&self) -> Sim3 {
        Sim3 {
            rotation: self.gravity.world_from_level.inverse(),
            translation: Vec3::zeros(),
            scale: self.scale,
        }
    }

    /// A state of the map's world in that levelled one.
    pub fn level(&self, state: &NavState) -> NavState {
        let level_from_world: So3 = self.gravity.world_from_level.inverse();
        NavState {
            world_from_imu: Se3::new(level_from_world, Vec3::zeros()) * state.world_from_imu,
            velocity: level_from_world * state.velocity,
            bias: state.bias,
        }
    }
}

/// A try: the tests it was put to, and what was found where anything was.
#[derive(Clone, Debug)]
pub struct Attempt {
    /// All tests with their numbers, passed and failed.
    pub gates: Vec<Gate>,
    /// What was found, good or not.
    pub found: Option<Initial>,
}

impl Attempt {
    /// What was found, when every test was passed.
    pub fn accepted(&self) -> Option<&Initial> {
        self.found.as_ref().filter(|_| self.gates.iter().all(|g| g.passed))
    }

    /// The tests that were failed.
    pub fn failed(&self) -> impl Iterator<Item = &Gate> {
        self.gates.iter().filter(|g| !g.passed)
    }
}

/// Tries to find scale, gravity and biases. `links[k]` sums the readings from key frame `k` to `k + 1`;
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
