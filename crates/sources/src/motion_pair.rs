//! Gyroscope and accelerometer, each at its own rate, as samples of one IMU.

use cairn_geometry::Vec3;
use cairn_sensor::{ImuSample, Stamp};
use std::collections::VecDeque;

/// Readings that are kept while the other sensor is silent.
const KEPT: usize = 2000;
/// Readings of the accelerometer further apart than this are not interpolated between, seconds.
const LONGEST_STEP_S: f64 = 0.1;

/// Joins both: a sample for each reading of the gyroscope, with the force interpolated between the accelerometer's readings
/// before and after it.
#[derive(Clone, Debug, Default)]
pub struct MotionPair {
    gyro: VecDeque<(Stamp, Vec3)>,
    accel: VecDeque<(Stamp, Vec3)>,
    /// Readings of the gyroscope without a force at their time.
    left_out: usize,
}

impl MotionPair {
    /// Takes a reading of the gyroscope, rad/s. Times that do not increase are left out.
    pub fn gyro(&mut self, stamp: Stamp, rate: Vec3) {
        self.left_out += usize::from(!push(&mut self.gyro, stamp, rate));
    }

    /// Takes a reading of the accelerometer, m/s^2.
    pub fn accel(&mut self, stamp: Stamp, force: Vec3) {
        push(&mut self.accel, stamp, force);
    }

    /// Whether no reading of the gyroscope waits for a force.
    pub fn is_empty(&self) -> bool {
        self.gyro.is_empty()
    }

    /// Readings of the gyroscope that were left out.
    pub fn left_out(&self) -> usize {
        self.left_out
    }

    /// Forgets what was read before one of the sensors was started anew.
    pub fn restart(&mut self) {
        self.gyro.clear();
        self.accel.clear();
    }

    /// The next sample; `None` until the accelerometer has a reading at or after it.
    pub fn pop(&mut self) -> Option<ImuSample> {
        loop {
            let (at, rate) = *self.gyro.front()?;
            while self.accel.get(1).is_some_and(|(next, _)| *next < at) {
                self.accel.pop_front();
            }
            let (t0, a0) = *self.accel.front()?;
            if t0 <= at {
                let (t1, a1) = *self.accel.get(1)?;
                self.gyro.pop_front();
                if t1 - t0 <= LONGEST_STEP_S {
                    let part = (at - t0) / (t1 - t0);
                    return Some(ImuSample::new(at, rate, a0 + (a1 - a0) * part));
                }
            } else {
                // The gyroscope began before the accelerometer.
                self.gyro.pop_front();
            }
            self.left_out += 1;
        }
    }
}

/// Adds a reading with a later time than the last; the oldest gives way.
fn push(queue: &mut VecDeque<(Stamp, Vec3)>, stamp: Stamp, value: Vec3) -> bool {
    if queue.back().is_some_and(|(last, _)| stamp <= *last) || !value.iter().all(|v| v.is_finite()) {
        return false;
    }
    if queue.len() == KEPT {
        queue.pop_front();
    }
    queue.push_back((stamp, value));
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn force_is_interpolated_at_the_gyroscopes_times() {
        let mut pair = MotionPair::default();
        let at = |s: f64| Stamp::from_seconds(s);
        for k in 0..40 {
            let t = 10.0 + 0.005 * f64::from(k);
            pair.gyro(at(t), Vec3::new(t, 0.0, 0.0));
        }
        assert!(pair.pop().is_none(), "no force yet");
        for k in 0..13 {
            let t = 10.002 + 0.016 * f64::from(k);
            pair.accel(at(t), Vec3::new(0.0, 3.0 * t, 9.8));
        }
        let samples: Vec<ImuSample> = std::iter::from_fn(|| pair.pop()).collect();
        // The first lies before any force, and those after the last force wait: 10.005 to 10.190.
        assert_eq!(samples.len(), 38);
        assert_eq!(pair.left_out(), 1);
        for s in &samples {
            let t = s.stamp.seconds();
            assert!((s.accel - Vec3::new(0.0, 3.0 * t, 9.8)).norm() < 1e-6 && (s.gyro.x - t).abs() < 1e-9);
        }
    }

    #[test]
    fn gaps_are_not_bridged_and_nothing_grows() {
        let mut pair = MotionPair::default();
        let at = |s: f64| Stamp::from_seconds(s);
        pair.accel(at(1.0), Vec3::zeros());
        pair.gyro(at(1.2), Vec3::zeros());
        pair.gyro(at(1.2), Vec3::zeros());
        pair.gyro(at(1.3), Vec3::new(f64::NAN, 0.0, 0.0));
        pair.accel(at(1.5), Vec3::zeros());
        assert!(pair.pop().is_none());
        assert_eq!(pair.left_out(), 3);
        (0..10_000).for_each(|k| pair.gyro(at(2.0 + 0.001 * f64::from(k)), Vec3::zeros()));
        assert_eq!(pair.gyro.len(), KEPT);
    }
}
