//! IMU samples of the recent past, ready to be preintegrated between any two instants.

use crate::{Bias, Preintegrated};
use cairn_geometry::Vec3;
use cairn_sensor::{ImuNoise, ImuSample, ImuSensor, Stamp};
use std::collections::VecDeque;

/// Why there are no samples between two instants, with the number that shows it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Missing {
    /// The instants are not in order.
    #[error("{0} s from the first instant to the second: they are not in order")]
    Order(f64),
    /// The samples begin later than the first instant.
    #[error("the samples begin {0:.4} s after the first instant")]
    Before(f64),
    /// The samples end earlier than the second instant, by more than may be bridged.
    #[error("the samples end {0:.4} s before the second instant")]
    After(f64),
    /// A hole is longer than may be bridged.
    #[error("there is no sample for {0:.4} s")]
    Hole(f64),
}

/// Holes of up to so many seconds are bridged in a stream.
const STREAM_HOLE_S: f64 = 0.1;
/// The last reading of a stream is extrapolated by so many seconds where the IMU is late.
const STREAM_HELD_S: f64 = 0.06;

/// The samples of the last packets.
#[derive(Clone, Debug)]
pub struct ImuBuffer {
    period_s: f64,
    noise: ImuNoise,
    hole_s: f64,
    hold_s: f64,
    samples: VecDeque<ImuSample>,
}

impl ImuBuffer {
    /// Of a sensor; holes of up to `hole_s` seconds are bridged by the line between their ends, with more noise.
    pub fn new(sensor: &ImuSensor, hole_s: f64) -> Self {
        let period_s = 1.0 / sensor.rate_hz;
        Self { period_s, noise: sensor.noise, hole_s, hold_s: 1.5 * period_s, samples: VecDeque::new() }
    }

    /// Of a sensor whose readings arrive in a stream beside images, and may arrive late.
    pub fn in_stream(sensor: &ImuSensor) -> Self {
        Self::new(sensor, STREAM_HOLE_S).holding(STREAM_HELD_S)
    }

    /// The same, its last sample extrapolated by so many seconds, with more noise.
    pub fn holding(self, hold_s: f64) -> Self {
        Self { hold_s: hold_s.max(1.5 * self.period_s), ..self }
    }

    /// Adds so many seconds to all stamps.
    pub fn shift(&mut self, seconds: f64) {
        self.samples.iter_mut().for_each(|s| s.stamp = s.stamp.plus_seconds(seconds));
    }

    /// Adds the samples of a packet. Extrapolated samples of the packet before are replaced by real ones.
    pub fn push(&mut self, samples: &[ImuSample]) {
        for sample in samples {
            while self.samples.back().is_some_and(ImuSample::is_synthesised) {
                self.samples.pop_back();
            }
            if self.samples.back().is_none_or(|last| last.stamp < sample.stamp) {
                self.samples.push_back(*sample);
            }
        }
    }

    /// Removes samples that are not needed to preintegrate from `stamp` on.
    pub fn forget_before(&mut self, stamp: Stamp) {
        while self.samples.get(1).is_some_and(|s| s.stamp <= stamp) {
            self.samples.pop_front();
        }
    }

    /// Removes the samples after `stamp`.
    pub fn forget_after(&mut self, stamp: Stamp) {
        self.samples.truncate(self.samples.partition_point(|s| s.stamp <= stamp));
    }

    /// The sensor's noise.
    pub fn noise(&self) -> ImuNoise {
        self.noise
    }

    /// Number of samples stored.
    pub fn len(&self) -> usize {
        self.samples.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.samples.is_empty()
    }

    /// The samples stored, in time order.
    pub fn samples(&self) -> impl DoubleEndedIterator<Item = &ImuSample> {
        self.samples.iter()
    }

    /// The stored samples of `from..=to`, as received.
    pub fn within(&self, from: Stamp, to: Stamp) -> impl DoubleEndedIterator<Item = &ImuSample> {
        let begin = self.samples.partition_point(|s| s.stamp < from);
        let end = self.samples.partition_point(|s| s.stamp <= to);
        self.samples.range(begin..end.max(begin))
    }

    /// Samples from one instant to another, both ends interpolated; the last is extrapolated by a period and a half, or as [`ImuBuffer::holding`] says.
    ///
    /// # Errors
    /// When samples are missing for a part of that time.
    pub fn between(&self, from: Stamp, to: Stamp) -> Result<Vec<ImuSample>, Missing> {
        if to <= from {
            return Err(Missing::Order(to - from));
        }
        let (Some(first), Some(last)) = (self.samples.front(), self.samples.back()) else {
            return Err(Missing::Before(f64::INFINITY));
        };
        if first.stamp > from {
            return Err(Missing::Before(first.stamp - from));
        }
        if to - last.stamp > self.hold_s {
            return Err(Missing::After(to - last.stamp));
        }
        let begin = self.samples.partition_point(|s| s.stamp <= from);
        let end = self.samples.partition_point(|s| s.stamp < to);
        let mut out = Vec::with_capacity(end.saturating_sub(begin) + 2);
        out.push(self.at(from));
        out.extend(self.samples.range(begin..end.max(begin)).copied());
        out.push(self.at(to));
        // Extrapolation beyond the last is a guess, the worse the longer.
        let held = (to - last.stamp) / self.period_s;
        if held > 1.5
            && let Some(s) = out.last_mut()
        {
            s.noise_scale = s.noise_scale.max(held);
        }
        for i in begin.max(1)..=end.min(self.samples.len() - 1) {
            let (a, b) = (&self.samples[i - 1], &self.samples[i]);
            let periods = (b.stamp - a.stamp) / self.period_s;
            if periods > 1.5 {
                if b.stamp - a.stamp > self.hole_s {
                    return Err(Missing::Hole(b.stamp - a.stamp));
                }
                // The line over a hole is the more uncertain the longer it is.
                for s in out.iter_mut().filter(|s| s.stamp >= a.stamp && s.stamp <= b.stamp) {
                    s.noise_scale = s.noise_scale.max(periods);
                }
            }
        }
        Ok(out)
    }

    /// The sum from one instant to another.
    ///
    /// # Errors
    /// As [`ImuBuffer::between`].
    pub fn preintegrate(&self, bias: Bias, from: Stamp, to: Stamp) -> Result<Preintegrated, Missing> {
        Ok(Preintegrated::of(self.noise, bias, self.between(from, to)?))
    }

    /// The reading at an instant, interpolated between its neighbours; constant beyond the last.
    fn at(&self, stamp: Stamp) -> ImuSample {
        let after = self.samples.partition_point(|s| s.stamp < stamp);
        match (after.checked_sub(1).and_then(|i| self.samples.get(i)), self.samples.get(after)) {
            (_, Some(exact)) if exact.stamp == stamp => *exact,
            (Some(a), Some(b)) => {
                let part = (stamp - a.stamp) / (b.stamp - a.stamp);
                let mix = |a: &Vec3, b: &Vec3| a + (b - a) * part;
                ImuSample {
                    stamp,
                    gyro: mix(&a.gyro, &b.gyro),
                    accel: mix(&a.accel, &b.accel),
                    noise_scale: a.noise_scale.max(b.noise_scale),
                }
            }
            (Some(only), None) | (None, Some(only)) => ImuSample { stamp, ..*only },
            (None, None) => ImuSample::new(stamp, Vec3::zeros(), Vec3::zeros()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Se3;

    fn sensor() -> ImuSensor {
        let noise = ImuNoise { gyro: 1e-4, gyro_walk: 1e-5, accel: 1e-3, accel_walk: 1e-4 };
        ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 }
    }

    fn ms(t: f64) -> Stamp {
        Stamp((t * 1e6).round() as i64)
    }

    fn sample(t: f64) -> ImuSample {
        ImuSample::new(ms(t), Vec3::new(t, 0.0, 0.0), Vec3::z() * 9.8)
    }

    #[test]
    fn interpolates_the_ends_and_keeps_samples_within() {
        let mut buffer = ImuBuffer::new(&sensor(), 0.1);
        buffer.push(&(0..5).map(|i| sample(5.0 * i as f64)).collect::<Vec<_>>());
        let cut = buffer.between(ms(7.0), ms(17.0)).unwrap();
        let readings: Vec<(i64, f64)> = cut.iter().map(|s| (s.stamp.0 / 1_000_000, s.gyro.x)).collect();
        assert_eq!(readings, [(7, 7.0), (10, 10.0), (15, 15.0), (17, 17.0)]);
        assert!(
            (buffer.preintegrate(Bias::default(), ms(7.0), ms(17.0)).unwrap().seconds() - 0.01).abs() < 1e-12
        );
        // Within one step, and at samples.
        assert_eq!(buffer.between(ms(11.0), ms(12.0)).unwrap().len(), 2);
        assert_eq!(buffer.between(ms(5.0), ms(10.0)).unwrap().len(), 2);
        buffer.forget_before(ms(12.0));
        assert_eq!((buffer.len(), buffer.between(ms(12.0), ms(20.0)).unwrap().len()), (3, 3));
    }

    #[test]
    fn reports_missing_samples_and_holes_raise_noise() {
        let mut buffer = ImuBuffer::new(&sensor(), 0.1);
        assert_eq!(buffer.between(ms(0.0), ms(1.0)), Err(Missing::Before(f64::INFINITY)));
        buffer.push(&[sample(0.0), sample(5.0), sample(45.0), sample(200.0)]);
        assert!(matches!(buffer.between(ms(-1.0), ms(5.0)), Err(Missing::Before(_))));
        assert!(matches!(buffer.between(ms(0.0), ms(208.0)), Err(Missing::After(_))));
        assert!(matches!(buffer.between(ms(0.0), ms(100.0)), Err(Missing::Hole(_))));
        assert!(matches!(buffer.between(ms(5.0), ms(5.0)), Err(Missing::Order(_))));
        let scales: Vec<f64> =
            buffer.between(ms(0.0), ms(45.0)).unwrap().iter().map(|s| s.noise_scale).collect();
        assert_eq!(scales, [1.0, 8.0, 8.0]);
    }

    #[test]
    fn extrapolated_samples_are_replaced() {
        let mut buffer = ImuBuffer::new(&sensor(), 0.1);
        buffer.push(&[sample(0.0), ImuSample { noise_scale: 10.0, ..sample(4.0) }]);
        assert_eq!(buffer.len(), 2);
        buffer.push(&[sample(3.0), sample(8.0)]);
        assert!(buffer.samples().all(|s| !s.is_synthesised()) && buffer.len() == 3);
    }
}
