//! The readings between two key frames, with what their residual is weighed by.

use super::chain::Block;
use crate::{Bias, Preintegrated};
use cairn_sensor::ImuNoise;
use std::cell::OnceCell;

/// A preintegrated sum and the root of the inverse of its covariance, which is computed once for each integration.
#[derive(Clone)]
pub struct Link {
    sum: Preintegrated,
    white: OnceCell<Option<Block>>,
}

impl Link {
    /// The sum with the white noise of (gyroscope, accelerometer) so many times larger.
    pub fn new(sum: &Preintegrated, times: [f64; 2]) -> Self {
        let n = sum.noise();
        let noise = ImuNoise { gyro: n.gyro * times[0], accel: n.accel * times[1], ..*n };
        let sum = Preintegrated::of(noise, *sum.bias(), sum.samples().to_vec());
        Self { sum, white: OnceCell::new() }
    }

    /// The same with so much more noise again.
    pub fn worse(&self, times: [f64; 2]) -> Self {
        Self::new(&self.sum, times)
    }

    /// What the readings add up to.
    pub fn sum(&self) -> &Preintegrated {
        &self.sum
    }

    /// [`Preintegrated::motion_whitening`].
    pub fn white(&self) -> Option<Block> {
        *self.white.get_or_init(|| self.sum.motion_whitening())
    }

    /// [`Preintegrated::reintegrate`].
    pub fn reintegrate(&mut self, bias: Bias) {
        self.sum.reintegrate(bias);
        self.white.take();
    }

    /// [`Preintegrated::follow`].
    pub fn follow(&mut self, bias: &Bias) {
        if self.sum.is_far(bias) {
            self.reintegrate(*bias);
        }
    }
}
