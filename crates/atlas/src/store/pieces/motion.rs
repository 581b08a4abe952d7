//! What an IMU measured, as robots send it: velocities and biases of key frames, and the readings between them in whole numbers, by which
//! a joint adjustment integrates them again at any bias.
//!
//! Readings of a key frame that was removed go on in those of the one after it: that is told, and they are not sent again.

mod delta;
#[cfg(test)]
mod tests;

use crate::scale::is_sound_sigma;
use crate::{ImuFactor, InertialState, KeyFrame, Snapshot};
use cairn_geometry::Vec3;
use cairn_inertial::Bias;
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use serde::{Deserialize, Serialize};

pub(super) use delta::MotionDelta;

/// Steps of a rad/s and of a m/s^2: rounding adds to the noise of a reading 1/60 of its variance at 1.7e-4 rad/s/sqrt(Hz) and
/// 2e-3 m/s^2/sqrt(Hz), 200 a second, less with noisier sensors.
const GYRO: f64 = 1_024.0;
const ACCEL: f64 = 128.0;
/// Steps of a m/s of velocity, and of a rad/s and a m/s^2 of bias.
const SPEED: f64 = 1_024.0;
const BIAS: [f64; 2] = [1_048_576.0, 16_384.0];
/// What an adjustment begins with is not sent again when it changed by no more than this: m/s, rad/s, m/s^2.
const CHANGED: [f64; 3] = [0.05, 1e-3, 0.02];
/// Nor are readings that moved by no more than so many microseconds.
const LATER_US: u64 = 200;
/// Largest readings, in steps: 1,000 rad/s and 8,000 m/s^2.
const LARGEST: i32 = 1_024_000;
/// So many readings between two key frames at most, and in all of a map.
const MAX_READINGS: usize = 1 << 14;
pub(super) const MAX_ALL: usize = 1 << 22;
/// Readings begin and end this near to their key frames, microseconds.
const NEAR_US: u64 = 2_000_000;

/// Velocity and biases of a key frame, in steps, and the standard deviation of standing still.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Motion {
    velocity: [i32; 3],
    gyro_bias: [i32; 3],
    accel_bias: [i32; 3],
    still_sigma: Option<f32>,
}

/// Readings since an earlier key frame.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Readings {
    pub since: u32,
    /// Which noise of the head they have.
    pub noise: u32,
    /// Microseconds of the first.
    begins: i64,
    /// Microseconds since the one before.
    steps: Vec<u32>,
    /// Gyro and accel, in steps.
    pub values: Vec<[i32; 6]>,
    /// Factors of noise: how many readings have which.
    scales: Vec<(u32, f32)>,
}

/// The IMU of a robot: pose of its camera on it, and noise densities.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct ImuHead {
    pub imu_from_camera: [f64; 7],
    pub noises: Vec<[f64; 4]>,
}

fn numbers(n: &ImuNoise) -> [f64; 4] {
    [n.gyro, n.gyro_walk, n.accel, n.accel_walk]
}

fn steps(of: &Vec3, per: f64) -> [i32; 3] {
    std::array::from_fn(|i| (of[i] * per).round() as i32)
}

fn vector(of: &[i32], per: f64) -> Vec3 {
    Vec3::from_fn(|i, _| f64::from(of[i]) / per)
}

impl ImuHead {
    /// Of a map whose camera is on an IMU.
    pub fn of(s: &Snapshot) -> Option<Self> {
        let imu_from_camera = super::super::about::numbers(s.imu_from_camera()?);
        let mut noises: Vec<[f64; 4]> = Vec::new();
        for noise in s.key_frames().filter_map(|k| Some(numbers(own_factor(k)?.sum.noise()))) {
            if !noises.contains(&noise) {
                noises.push(noise);
            }
        }
        Some(Self { imu_from_camera, noises })
    }
}

/// The factor of a key frame of the atlas's camera.
fn own_factor(k: &KeyFrame) -> Option<&ImuFactor> {
    k.motion.as_ref().filter(|_| k.other_camera.is_none())?.imu_factor.as_ref()
}

impl Motion {
    /// Of a key frame of the atlas's camera, as `known` where it hardly changed.
    pub fn of(k: &KeyFrame, known: Option<&Self>) -> Option<Self> {
        let m = k.motion.as_ref().filter(|_| k.other_camera.is_none())?;
        let now = Self {
            velocity: steps(&m.velocity, SPEED),
            gyro_bias: steps(&m.bias.gyro, BIAS[0]),
            accel_bias: steps(&m.bias.accel, BIAS[1]),
            still_sigma: m.still_sigma.map(|sigma| sigma as f32).filter(|s| is_sound_sigma(f64::from(*s))),
        };
        let near = |known: &&Self| {
            let (was, is) = (known.state(), now.state());
            let off =
                [was.velocity - is.velocity, was.bias.gyro - is.bias.gyro, was.bias.accel - is.bias.accel];
            known.still_sigma == now.still_sigma
                && off.iter().zip(CHANGED).all(|(off, most)| off.norm() <= most)
        };
        Some(known.filter(near).copied().unwrap_or(now))
    }

    /// Without readings.
    pub fn state(&self) -> InertialState {
        let bias = Bias { gyro: vector(&self.gyro_bias, BIAS[0]), accel: vector(&self.accel_bias, BIAS[1]) };
        let still_sigma = self.still_sigma.map(f64::from);
        InertialState { velocity: vector(&self.velocity, SPEED), bias, still_sigma, imu_factor: None }
    }
}

impl Readings {
    /// Those before a key frame of the atlas's camera; `None` where there are none, or they cannot be told.
    pub fn of(s: &Snapshot, k: &KeyFrame, head: &ImuHead) -> Option<Self> {
        let factor = own_factor(k)?;
        let before = s.key_frame(factor.since).filter(|before| before.map == k.map && before.id < k.id)?;
        let noise = head.noises.iter().position(|n| *n == numbers(factor.sum.noise()))? as u32;
        let us = |s: &ImuSample| (s.stamp.0 + 500).div_euclid(1_000);
        let samples = factor.sum.samples();
        let is_finite = |s: &ImuSample| s.gyro.iter().chain(&s.accel).all(|v| v.is_finite());
        if !samples.iter().all(is_finite) {
            return None;
        }
        let begins = us(samples.first()?);
        let mut of = Self {
            since: factor.since.raw(),
            noise,
            begins,
            steps: Vec::new(),
            values: Vec::new(),
            scales: Vec::new(),
        };
        let mut last = begins;
        for s in samples {
            let at = us(s);
            if at == last && !of.values.is_empty() {
                continue;
            }
            of.steps.push(u32::try_from(at - std::mem::replace(&mut last, at)).ok()?);
            let ([a, b, c], [d, e, f]) = (steps(&s.gyro, GYRO), steps(&s.accel, ACCEL));
            of.values.push([a, b, c, d, e, f]);
            of.scale(s.noise_scale as f32, 1);
        }
        of.is_sound(head, before.stamp, k.stamp).then_some(of)
    }

    /// Adds a factor of noise of so many readings.
    fn scale(&mut self, scale: f32, times: u32) {
        match self.scales.last_mut() {
            Some((n, last)) if *last == scale => *n += times,
            _ => self.scales.push((times, scale)),
        }
    }

    fn ends(&self) -> i64 {
        self.begins.saturating_add(self.steps.iter().map(|step| i64::from(*step)).sum())
    }

    /// These, and then those of the next key frame; `None` where they do not follow.
    pub fn then(&self, next: &Self) -> Option<Self> {
        let (mut all, ends) = (self.clone(), self.ends());
        if all.noise != next.noise || all.values.len() + next.values.len() > MAX_READINGS {
            return None;
        }
        let (mut at, mut last) = (next.begins, ends);
        let mut scales = next.scales.iter().flat_map(|(n, scale)| std::iter::repeat_n(*scale, *n as usize));
        for (step, values) in next.steps.iter().zip(&next.values) {
            at = at.checked_add(i64::from(*step))?;
            let scale = scales.next()?;
            if at > last {
                all.steps.push(u32::try_from(at - std::mem::replace(&mut last, at)).ok()?);
                all.values.push(*values);
                all.scale(scale, 1);
            }
        }
        Some(all)
    }

    /// Whether they are as good as these.
    pub fn is_near(&self, other: &Self) -> bool {
        self.begins.abs_diff(other.begins) <= LATER_US
            && self.ends().abs_diff(other.ends()) <= LATER_US
            && (self.since, self.noise) == (other.since, other.noise)
            && (&self.values, &self.scales) == (&other.values, &other.scales)
    }

    /// Whether there are readings in rising time near to these stamps, with values that sensors have.
    pub fn is_sound(&self, head: &ImuHead, from: Stamp, to: Stamp) -> bool {
        let near = |us: i64, stamp: Stamp| us.abs_diff(stamp.0.div_euclid(1_000)) <= NEAR_US;
        let counted: u64 = self.scales.iter().map(|(n, _)| u64::from(*n)).sum();
        let noise = head.noises.get(self.noise as usize);
        (2..=MAX_READINGS).contains(&self.values.len())
            && self.steps.len() == self.values.len()
            && counted == self.values.len() as u64
            && self.steps[0] == 0
            && self.steps[1..].iter().all(|step| *step > 0)
            && self.values.iter().flatten().all(|v| v.unsigned_abs() <= LARGEST.unsigned_abs())
            && self.scales.iter().all(|(_, s)| s.is_finite() && *s > 0.0)
            && noise.is_some_and(|n| n.iter().all(|n| n.is_finite() && *n > 0.0))
            && near(self.begins, from)
            && near(self.ends(), to)
    }

    /// As samples.
    pub fn samples(&self) -> Vec<ImuSample> {
        let scales = self.scales.iter().flat_map(|(n, scale)| std::iter::repeat_n(*scale, *n as usize));
        let mut at = self.begins;
        let one = |((step, v), scale): ((&u32, &[i32; 6]), f32)| {
            at += i64::from(*step);
            let (gyro, accel) = (vector(&v[..3], GYRO), vector(&v[3..], ACCEL));
            ImuSample { stamp: Stamp(at * 1_000), gyro, accel, noise_scale: f64::from(scale) }
        };
        self.steps.iter().zip(&self.values).zip(scales).map(one).collect()
    }
}
