//! Faults of an IMU stream: a lower rate, a clock offset, lost samples, bias jumps.

use cairn_geometry::Vec3;
use cairn_random::Random;
use cairn_sensor::ImuSample;

/// The faults of a stream of readings, simulated or recorded; the default is none.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuTroubles {
    /// Each output reading is the mean of this many, stamped in their middle, as from a sensor set to that rate.
    pub mean_of: usize,
    /// What has to be added to the stamps: `t_imu + offset = t_image`. The rig does not state it.
    pub offset_s: f64,
    /// Share of the readings that are lost, 0 to 1.
    pub lost: f64,
    /// Seconds between jumps of both biases; 0: no jumps.
    pub bias_steps_s: f64,
    /// Size of a jump on each axis, one standard deviation: rad/s and m/s^2.
    pub bias_step: [f64; 2],
}

impl Default for ImuTroubles {
    fn default() -> Self {
        Self { mean_of: 1, offset_s: 0.0, lost: 0.0, bias_steps_s: 0.0, bias_step: [0.003, 0.05] }
    }
}

/// Passes readings one by one, with the faults applied.
pub(crate) struct Troubled {
    troubles: ImuTroubles,
    random: Random,
    pending: Vec<ImuSample>,
    bias: [Vec3; 2],
    next_step: Option<cairn_sensor::Stamp>,
}

impl Troubled {
    pub fn new(troubles: ImuTroubles, seed: u64) -> Self {
        let (pending, bias) = (Vec::new(), [Vec3::zeros(); 2]);
        Self { troubles, random: Random::stream(seed, 0x7B0B), pending, bias, next_step: None }
    }

    /// The reading that is output after this one, if any.
    pub fn pass(&mut self, sample: ImuSample) -> Option<ImuSample> {
        let t = self.troubles;
        if t.bias_steps_s > 0.0 {
            let next = *self.next_step.get_or_insert(sample.stamp.plus_seconds(t.bias_steps_s));
            if sample.stamp >= next {
                self.next_step = Some(next.plus_seconds(t.bias_steps_s));
                for (bias, size) in self.bias.iter_mut().zip(t.bias_step) {
                    let r = &mut self.random;
                    *bias += Vec3::new(r.standard_normal(), r.standard_normal(), r.standard_normal()) * size;
                }
            }
        }
        self.pending.push(sample);
        if self.pending.len() < t.mean_of.max(1) {
            return None;
        }
        let n = self.pending.len() as f64;
        let mean = |of: fn(&ImuSample) -> Vec3| self.pending.iter().map(of).sum::<Vec3>() / n;
        let (gyro, accel) = (mean(|s| s.gyro) + self.bias[0], mean(|s| s.accel) + self.bias[1]);
        let (first, last) = (self.pending[0].stamp, sample.stamp);
        self.pending.clear();
        if t.lost > 0.0 && self.random.chance(t.lost) {
            return None;
        }
        Some(ImuSample::new(first.plus_seconds(0.5 * (last - first) - t.offset_s), gyro, accel))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::Stamp;

    fn through(troubles: ImuTroubles) -> Vec<ImuSample> {
        let mut troubled = Troubled::new(troubles, 3);
        let sample = |i: i64| ImuSample::new(Stamp(i * 5_000_000), Vec3::x() * i as f64, Vec3::z() * 9.81);
        (0..4000).filter_map(|i| troubled.pass(sample(i))).collect()
    }

    #[test]
    fn imu_faults_are_applied() {
        assert_eq!(
            through(ImuTroubles::default())[7],
            ImuSample::new(Stamp(35_000_000), Vec3::x() * 7.0, Vec3::z() * 9.81)
        );
        let half = through(ImuTroubles { mean_of: 2, ..Default::default() });
        assert_eq!((half.len(), half[1].stamp, half[1].gyro.x), (2000, Stamp(12_500_000), 2.5));
        let off = through(ImuTroubles { offset_s: 0.02, ..Default::default() });
        assert_eq!(off[10].stamp, Stamp(50_000_000 - 20_000_000));
        let lost = through(ImuTroubles { lost: 0.01, ..Default::default() });
        assert!((3930..3990).contains(&lost.len()), "{}", lost.len());
        let steps = through(ImuTroubles { bias_steps_s: 10.0, ..Default::default() });
        assert_eq!(steps[1999].accel, Vec3::z() * 9.81);
        let jump = steps[2000].accel - steps[1999].accel;
        assert!((0.005..0.3).contains(&jump.norm()), "{jump:?}");
        assert_eq!(steps[3999].accel, steps[2000].accel);
    }
}
