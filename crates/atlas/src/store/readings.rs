//! IMU readings between key frames in a saved map, in parts of 64 key frames: what makes IMU factors of them again. Written where there are
//! any; programs that do not know them leave them out.
//!
//! ```text
//! factors n u32 | columns of n: row of the key frame u32, row of the earlier one u32, readings u32,
//! noise f64 (gyro, its walk, accel, its walk) | columns of all readings: stamp i64, gyro and accel 3 f32 each, factor of noise f32
//! ```
//!
//! Readings are rounded to single precision, a hundredth of what the converters of these sensors resolve.

use super::chunks;
use super::container::Parts;
use super::error::StoreError;
use super::layout::READINGS;
use super::wire::{Decoder, Encoder};
use crate::{ImuFactor, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_inertial::Preintegrated;
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use std::sync::Arc;

/// The part of a chunk of key frames; `None` where none of them has a factor. What could not be read again is left out.
pub(super) fn encode(
    chunk: &[&KeyFrame],
    snapshot: &Snapshot,
    row: impl Fn(KeyFrameId) -> u32,
) -> Option<Vec<u8>> {
    let factor = |k: &&KeyFrame| {
        let factor = k.motion.as_ref()?.imu_factor.clone()?;
        let before = snapshot.key_frame(factor.since)?;
        let valid = before.id < k.id && before.map == k.map;
        (valid && are_sound(factor.sum.noise(), factor.sum.samples())).then(|| (row(k.id), factor))
    };
    let factors: Vec<(u32, ImuFactor)> = chunk.iter().filter_map(factor).collect();
    if factors.is_empty() {
        return None;
    }
    let mut e = Encoder::default();
    e.u32(factors.len() as u32);
    e.column_u32(&factors.iter().map(|(row, _)| *row).collect::<Vec<_>>());
    e.column_u32(&factors.iter().map(|(_, f)| row(f.since)).collect::<Vec<_>>());
    e.column_u32(&factors.iter().map(|(_, f)| f.sum.samples().len() as u32).collect::<Vec<_>>());
    for i in 0..4 {
        e.column_f64(&factors.iter().map(|(_, f)| numbers(f.sum.noise())[i]).collect::<Vec<_>>());
    }
    let samples: Vec<&ImuSample> = factors.iter().flat_map(|(_, f)| f.sum.samples()).collect();
    e.column(samples.iter().map(|s| s.stamp.0.to_le_bytes()));
    let mut column = |of: &dyn Fn(&ImuSample) -> f64| {
        e.column_f32(&samples.iter().map(|s| of(s) as f32).collect::<Vec<_>>());
    };
    (0..3).for_each(|i| column(&|s| s.gyro[i]));
    (0..3).for_each(|i| column(&|s| s.accel[i]));
    column(&|s| s.noise_scale);
    Some(e.0)
}

/// Gives key frames their factors, integrated at their biases.
pub(super) fn read(parts: &Parts, key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    chunks::read(READINGS, parts, key_frames, read_chunk)
}

fn read_chunk(name: &str, bytes: &[u8], key_frames: &mut [KeyFrame]) -> Result<(), StoreError> {
    let mut d = Decoder::new(name, bytes);
    let n = d.u32()? as usize;
    let (rows, earlier, counts) = (d.column_u32(n)?, d.column_u32(n)?, d.column_u32(n)?);
    let mut noises: [Vec<f64>; 4] = Default::default();
    for column in &mut noises {
        *column = d.column_f64(n)?;
    }
    let total = counts.iter().map(|n| *n as usize).sum();
    let stamps = d.column_i64(total)?;
    let mut columns: [Vec<f32>; 7] = Default::default();
    for column in &mut columns {
        *column = d.column_f32(total)?;
    }
    let mut samples = (0..total).map(|i| {
        let vector = |at: usize| Vec3::from_fn(|k, _| f64::from(columns[at + k][i]));
        let noise_scale = f64::from(columns[6][i]);
        ImuSample { stamp: Stamp(stamps[i]), gyro: vector(0), accel: vector(3), noise_scale }
    });
    for i in 0..n {
        let own: Vec<ImuSample> = samples.by_ref().take(counts[i] as usize).collect();
        let [gyro, gyro_walk, accel, accel_walk] = std::array::from_fn(|k| noises[k][i]);
        let noise = ImuNoise { gyro, gyro_walk, accel, accel_walk };
        let wrong = || StoreError::part(name, format!("the readings before row {} are invalid", rows[i]));
        let before = key_frames.get(earlier[i] as usize).map(|k| (k.id, k.map));
        let (before, k) = before.zip(key_frames.get_mut(rows[i] as usize)).ok_or_else(wrong)?;
        let valid = before.0 < k.id && before.1 == k.map && are_sound(&noise, &own);
        let motion = k.motion.as_mut().filter(|_| valid).ok_or_else(wrong)?;
        let sum = Arc::new(Preintegrated::of(noise, motion.bias, own));
        motion.imu_factor = Some(ImuFactor { since: before.0, sum });
    }
    d.end()
}

fn are_sound(noise: &ImuNoise, samples: &[ImuSample]) -> bool {
    let finite = |s: &ImuSample| s.gyro.iter().chain(&s.accel).all(|x| x.is_finite());
    numbers(noise).iter().all(|x| x.is_finite() && *x > 0.0)
        && samples.len() > 1
        && samples.windows(2).all(|w| w[0].stamp < w[1].stamp)
        && samples.iter().all(|s| finite(s) && s.noise_scale.is_finite() && s.noise_scale > 0.0)
}

fn numbers(noise: &ImuNoise) -> [f64; 4] {
    [noise.gyro, noise.gyro_walk, noise.accel, noise.accel_walk]
}
