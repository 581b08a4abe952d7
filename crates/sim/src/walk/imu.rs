//! The readings of an IMU on a moving body: exact values, white noise, bias random walk.
//!
//! Source: discrete noise from densities as in Crassidis, "Sigma-point Kalman filtering for integrated GPS and
//! inertial navigation" (2006), eq. 4-6: white noise `sigma / sqrt(dt)`, bias step `sigma_walk * sqrt(dt)`.

use super::ContinuousTrajectory;
use cairn_geometry::{Se3, Vec3};
use cairn_random::Random;
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, ImuSensor, Stamp};

/// The config of the simulated IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuConfig {
    /// Samples a second.
    pub rate_hz: f64,
    /// Noise densities (default: ADIS16448 as in EuRoC).
    pub noise: ImuNoise,
    /// False gives exact readings; the rig still states the densities.
    pub noisy: bool,
}

impl Default for ImuConfig {
    fn default() -> Self {
        let noise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };
        Self { rate_hz: 200.0, noise, noisy: true }
    }
}

impl ImuConfig {
    /// The sensor as stated in the rig; it is at the body's origin.
    pub(crate) fn sensor(&self) -> ImuSensor {
        ImuSensor { body_from_imu: Se3::identity(), rate_hz: self.rate_hz, noise: self.noise, offset_s: 0.0 }
    }
}

/// Generates samples one after the other.
pub(crate) struct ImuSim {
    config: ImuConfig,
    random: Random,
    gyro_bias: Vec3,
    accel_bias: Vec3,
    next: u64,
}

impl ImuSim {
    /// From the first sample at time 0.
    pub fn new(config: ImuConfig, seed: u64) -> Self {
        let mut random = Random::stream(seed, 0x1A1);
        let mut vector = |s: f64| {
            Vec3::new(
                random.standard_normal() * s,
                random.standard_normal() * s,
                random.standard_normal() * s,
            )
        };
        let (gyro_bias, accel_bias) =
            if config.noisy { (vector(2e-3), vector(2e-2)) } else { Default::default() };
        Self { config, random, gyro_bias, accel_bias, next: 0 }
    }

    /// The next sample; its time is nanoseconds after `epoch`.
    pub fn next(&mut self, motion: &ContinuousTrajectory, epoch: Stamp) -> ImuSample {
        let t = (self.next as f64 * 1e9 / self.config.rate_hz).round() as i64;
        self.next += 1;
        self.sample(motion, epoch, t)
    }

    fn sample(&mut self, motion: &ContinuousTrajectory, epoch: Stamp, t: i64) -> ImuSample {
        let state = motion.state(t as f64 * 1e-9);
        let force = state.acceleration + Vec3::z() * GRAVITY_M_S2;
        let mut gyro = state.rate;
        let mut accel = state.world_from_body.rotation.inverse() * force;
        if self.config.noisy {
            let (n, root) = (self.config.noise, self.config.rate_hz.sqrt());
            let r = &mut self.random;
            let mut vector =
                |s: f64| Vec3::new(r.standard_normal() * s, r.standard_normal() * s, r.standard_normal() * s);
            gyro += self.gyro_bias + vector(n.gyro * root);
            accel += self.accel_bias + vector(n.accel * root);
            self.gyro_bias += vector(n.gyro_walk / root);
            self.accel_bias += vector(n.accel_walk / root);
        }
        ImuSample::new(Stamp(epoch.0 + t), gyro, accel)
    }
}
