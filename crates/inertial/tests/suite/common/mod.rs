//! A motion in closed form and what an inertial sensor reads on it.
#![allow(dead_code)]

use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, Gravity, NavState};
use cairn_random::Random;
use cairn_sensor::{ImuNoise, ImuSample, Stamp};

pub const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };

/// A hand in motion, in closed form: rotation as the product of turns about fixed axes, position as sines.
pub struct HandMotion;

impl HandMotion {
    pub fn rotation(t: f64) -> So3 {
        So3::exp(&(Vec3::new(0.9, 0.2, 0.1) * (0.8 * (1.7 * t).sin())))
            * So3::exp(&(Vec3::new(0.0, 0.3, 1.0) * (1.1 * (0.9 * t).sin() + 0.4 * t)))
    }

    pub fn position(t: f64) -> Vec3 {
        Vec3::new((1.3 * t).sin(), 0.6 * (2.1 * t).cos(), 0.3 * (3.0 * t).sin()) * 0.7
    }

    pub fn velocity(t: f64) -> Vec3 {
        (Self::position(t + 1e-4) - Self::position(t - 1e-4)) / 2e-4
    }

    pub fn acceleration(t: f64) -> Vec3 {
        let w = Vec3::new(
            1.3 * 1.3 * (1.3 * t).sin(),
            0.6 * 2.1 * 2.1 * (2.1 * t).cos(),
            0.3 * 9.0 * (3.0 * t).sin(),
        );
        w * -0.7
    }

    pub fn state(t: f64, bias: Bias) -> NavState {
        let world_from_imu = Se3::new(Self::rotation(t), Self::position(t));
        NavState { world_from_imu, velocity: Self::velocity(t), bias }
    }

    pub fn sample(t: f64) -> ImuSample {
        let r = Self::rotation(t);
        let gyro = (Self::rotation(t - 1e-4).inverse() * Self::rotation(t + 1e-4)).log() / 2e-4;
        let accel = r.inverse() * (Self::acceleration(t) - Gravity::level().vector());
        ImuSample::new(Stamp::from_seconds(t), gyro, accel)
    }
}

pub fn samples(from: f64, seconds: f64, rate: f64) -> Vec<ImuSample> {
    (0..=(seconds * rate).round() as usize).map(|i| HandMotion::sample(from + i as f64 / rate)).collect()
}

pub fn some_bias() -> Bias {
    Bias { gyro: Vec3::new(0.01, -0.02, 0.015), accel: Vec3::new(0.1, -0.05, 0.2) }
}

/// Readings with white noise and wandering biases, and the biases at the end.
pub fn noisy(rng: &mut Random, mut samples: Vec<ImuSample>, mut bias: Bias) -> (Vec<ImuSample>, Bias) {
    let rate = 1.0 / (samples[1].stamp - samples[0].stamp);
    let root = rate.sqrt();
    for s in &mut samples {
        s.gyro += bias.gyro + vector(rng, NOISE.gyro * root);
        s.accel += bias.accel + vector(rng, NOISE.accel * root);
        bias.gyro += vector(rng, NOISE.gyro_walk / root);
        bias.accel += vector(rng, NOISE.accel_walk / root);
    }
    (samples, bias)
}

/// Three draws of a normal distribution.
pub fn vector(rng: &mut Random, sigma: f64) -> Vec3 {
    Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma
}
