//! Whether the readings of an IMU are those of a sensor that works, by the readings alone.
//!
//! In: readings in time order, as they come. Out: for each what is wrong with it or with the ones before it, with the numbers. White
//! noise makes no reading repeat the one before for long, a free fall without noise does not happen, and nobody turns faster than a
//! gyroscope can measure (plausibility, stuck-at and gap tests of Ni et al., "Sensor network data fault types", ACM TOSN 2009,
//! section 4). What they cannot tell is left to vision ([`crate::innovation`]).

use crate::RestConfig;
use cairn_geometry::Vec3;
use cairn_sensor::{GRAVITY_M_S2, ImuSample, Stamp};
use serde::{Deserialize, Serialize};

/// The end of the range of most gyroscopes (2000 degrees a second) and accelerometers (16 g), a little less: rad/s and m/s^2. No motion
/// of the recordings that the engine was measured on comes near: 3.8 rad/s in the hand, 42 m/s^2 on a drone.
const RANGE: [f64; 2] = [34.0, 155.0];
/// A reading that differs by more than this from the one before it, and from the one after, is not of a motion: rad/s and m/s^2 on one
/// axis. Of 153,000 readings of EuRoC, TUM-VI and rendered walks at 200 Hz none differs from the next by more than 1.6 and 28.
const JUMP: [f64; 2] = [6.0, 60.0];
/// Readings that are equal to the one before: from so many on, a sensor that did not repeat itself before is stuck. Of 150,000 readings of
/// EuRoC and TUM-VI no two of the accelerometer are equal, and no three of the gyroscope.
const REPEATED: usize = 8;
/// The same where the readings may be those of a sensor that lies still: of a sensor that repeats nine of ten readings there, one run in
/// five hundred is as long, and the first that is shorter shows that it rounds.
const REPEATED_AT_REST: usize = 60;
/// How far the readings of one that lies still spread, in the standard deviations that count as rest: of sixty normal ones with that
/// deviation, one set in 25 spreads further.
const SPREAD: f64 = 6.0;
/// A sensor is known not to repeat itself after so many different readings with runs of at most [`NATURAL`]: a browser rounds readings,
/// and a phone on a table repeats them.
const KNOWN: usize = 200;
const NATURAL: usize = 3;
/// Readings of exactly no force.
const NO_FORCE: usize = 3;
/// No reading for so long, seconds: nothing bridges it, and what comes after it may be of another time.
const SILENT_S: f64 = 0.1;

/// What is wrong with readings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, thiserror::Error)]
pub enum ImuFault {
    /// All numbers repeat.
    #[error("the readings repeat themselves for {seconds:.2} s")]
    Stuck {
        /// For so long.
        seconds: f64,
    },
    /// Those of the gyroscope repeat, and the accelerometer goes on.
    #[error("the gyroscope repeats itself for {seconds:.2} s")]
    GyroStuck {
        /// For so long.
        seconds: f64,
    },
    /// Those of the accelerometer repeat, and the gyroscope goes on.
    #[error("the accelerometer repeats itself for {seconds:.2} s")]
    AccelStuck {
        /// For so long.
        seconds: f64,
    },
    /// The accelerometer feels nothing at all.
    #[error("the accelerometer feels no force for {seconds:.2} s")]
    NoForce {
        /// For so long.
        seconds: f64,
    },
    /// A number is beyond what such sensors measure, or is none.
    #[error("a reading of {found:.1} is beyond {most:.0}")]
    OutOfRange {
        /// The number, rad/s or m/s^2.
        found: f64,
        /// The bound.
        most: f64,
    },
    /// A number differs from that of the reading before by more than motion does.
    #[error("a reading differs by {found:.1} from the one before, which is beyond {most:.0}")]
    Spike {
        /// By how much, rad/s or m/s^2.
        found: f64,
        /// The bound.
        most: f64,
    },
    /// There was no reading.
    #[error("there was no reading for {seconds:.2} s")]
    Silent {
        /// For so long.
        seconds: f64,
    },
    /// The gyroscope turns otherwise than the images.
    #[error("the gyroscope differs from the images by {off_rad:.4} rad +- {sigma_rad:.4} in {seconds:.2} s")]
    TurnsOtherwise {
        /// Angle between the two.
        off_rad: f64,
        /// What it may be.
        sigma_rad: f64,
        /// Time in which it came up.
        seconds: f64,
    },
    /// The accelerometer moves otherwise than the images.
    #[error("the accelerometer differs from the images by {off_m:.4} m +- {sigma_m:.4} in {seconds:.2} s")]
    MovesOtherwise {
        /// Distance between the two.
        off_m: f64,
        /// What it may be.
        sigma_m: f64,
        /// Time in which it came up.
        seconds: f64,
    },
}

/// A fault, and since when the readings have it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Failed {
    /// What is wrong.
    pub fault: ImuFault,
    /// The time of the first reading that is wrong.
    pub since: Stamp,
}

/// Readings that are equal to the ones before.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    /// How many there are now, the first one included.
    length: usize,
    since: Option<Stamp>,
    /// The least and the greatest that the other half of the sensor measured meanwhile, each axis.
    beside: [Vec3; 2],
    /// How many have ended, and the longest of them that was taken for natural.
    ended: usize,
    longest: usize,
}

impl Run {
    /// The next reading, and what the other half of the sensor measured with it; `rested` says whether the ones before may be those of a
    /// sensor that lies still.
    fn take(&mut self, stamp: Stamp, beside: Vec3, is_equal: bool, rested: bool) {
        if is_equal {
            self.length += 1;
            self.beside = [self.beside[0].inf(&beside), self.beside[1].sup(&beside)];
            return;
        }
        self.beside = [beside; 2];
        if rested || !self.is_too_long() {
            self.longest = self.longest.max(self.length);
        }
        self.ended += 1;
        (self.length, self.since) = (1, Some(stamp));
    }

    fn is_too_long(&self) -> bool {
        self.length >= REPEATED
    }

    /// Whether the other half of the sensor has moved by more than this meanwhile, on any axis: then it does not lie still.
    fn moved(&self, most: f64) -> bool {
        (self.beside[1] - self.beside[0]).max() > most
    }

    /// Whether it is known that the sensor does not repeat itself by its nature.
    fn is_known(&self) -> bool {
        self.ended >= KNOWN && self.longest <= NATURAL
    }
}

/// Tests readings one by one.
#[derive(Clone, Debug, Default)]
pub struct ReadingsCheck {
    last: Option<ImuSample>,
    /// The reading before, where that was a spike.
    spike: Option<ImuSample>,
    /// Of all numbers, of the gyroscope's, of the accelerometer's.
    runs: [Run; 3],
    no_force: usize,
}

impl ReadingsCheck {
    /// The clock of the readings is found to be off: what came before is moved by so many seconds, as what comes will be.
    pub fn shift(&mut self, seconds: f64) {
        let stamps = self.last.iter_mut().chain(&mut self.spike).map(|sample| &mut sample.stamp);
        let begins = self.runs.iter_mut().filter_map(|run| run.since.as_mut());
        stamps.chain(begins).for_each(|stamp| *stamp = stamp.plus_seconds(seconds));
    }

    /// What is wrong with a reading that comes after the ones before; `None` where nothing is.
    pub fn test(&mut self, sample: &ImuSample) -> Option<Failed> {
        let failed = |fault, since| Some(Failed { fault, since });
        if let Some(fault) = out_of_range(sample) {
            return failed(fault, sample.stamp);
        }
        if let Some(fault) = self.spike(sample) {
            self.spike = Some(*sample);
            return failed(fault, sample.stamp);
        }
        self.spike = None;
        let last = self.last.replace(*sample);
        let equal = last.map_or([false; 2], |l| [l.gyro == sample.gyro, l.accel == sample.accel]);
        let silent_s = last.map_or(0.0, |l| sample.stamp - l.stamp);
        let rested = last.as_ref().is_some_and(may_rest);
        let of = [(Vec3::zeros(), equal[0] && equal[1]), (sample.accel, equal[0]), (sample.gyro, equal[1])];
        for (run, (beside, is_equal)) in self.runs.iter_mut().zip(of) {
            run.take(sample.stamp, beside, is_equal, rested);
        }
        self.no_force = if sample.accel == Vec3::zeros() { self.no_force + 1 } else { 0 };
        if let Some(stuck) = self.stuck(sample) {
            return Some(stuck);
        }
        if silent_s > SILENT_S {
            return failed(ImuFault::Silent { seconds: silent_s }, sample.stamp);
        }
        None
    }

    /// Whether a reading leaves the one before it far behind. One that stays where the one before went is no spike.
    fn spike(&self, sample: &ImuSample) -> Option<ImuFault> {
        let jump = |from: &ImuSample| jump(from, sample).filter(|_| sample.stamp - from.stamp <= SILENT_S);
        let fault = jump(self.last.as_ref()?)?;
        match &self.spike {
            Some(spike) if jump(spike).is_none() => None,
            _ => Some(fault),
        }
    }

    fn stuck(&self, sample: &ImuSample) -> Option<Failed> {
        let [all, gyro, accel] = &self.runs;
        let since = |run: &Run| run.since.unwrap_or(sample.stamp);
        let seconds = |run: &Run| sample.stamp - since(run);
        // A sensor that lies still may begin to repeat itself by rounding.
        let rest = RestConfig::default();
        let is_stuck = |run: &Run, floor: f64| {
            let may_rest = may_rest(sample) && !run.moved(SPREAD * floor);
            run.is_known() && run.length >= if may_rest { REPEATED_AT_REST } else { REPEATED }
        };
        let (run, fault) = if self.no_force >= NO_FORCE {
            (accel, ImuFault::NoForce { seconds: seconds(accel) })
        } else if is_stuck(all, f64::INFINITY) {
            (all, ImuFault::Stuck { seconds: seconds(all) })
        } else if is_stuck(gyro, rest.accel_floor) {
            (gyro, ImuFault::GyroStuck { seconds: seconds(gyro) })
        } else if is_stuck(accel, rest.gyro_floor) {
            (accel, ImuFault::AccelStuck { seconds: seconds(accel) })
        } else {
            return None;
        };
        Some(Failed { fault, since: since(run) })
    }
}

fn out_of_range(sample: &ImuSample) -> Option<ImuFault> {
    let beyond = |v: &Vec3, most: f64| {
        let found = v.iter().copied().find(|v| v.is_nan() || v.abs() > most)?;
        Some(ImuFault::OutOfRange { found, most })
    };
    beyond(&sample.gyro, RANGE[0]).or_else(|| beyond(&sample.accel, RANGE[1]))
}

/// Whether two readings differ by more than those of a motion do.
fn jump(from: &ImuSample, to: &ImuSample) -> Option<ImuFault> {
    let of = |by: Vec3, most: f64| {
        let found = by.amax();
        (found > most).then_some(ImuFault::Spike { found, most })
    };
    of(to.gyro - from.gyro, JUMP[0]).or_else(|| of(to.accel - from.accel, JUMP[1]))
}

/// Whether a reading may be that of a sensor that lies still, whose repetition does no harm.
fn may_rest(sample: &ImuSample) -> bool {
    let rest = RestConfig::default();
    sample.gyro.norm() <= rest.unknown_bias && (sample.accel.norm() - GRAVITY_M_S2).abs() <= rest.force
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    /// Readings at 200 Hz of a sensor that is moved, with noise, changed from 2 s on for `seconds`; the faults found, with the time of
    /// the reading at which each was.
    fn faults(seconds: f64, change: impl Fn(&mut ImuSample, &ImuSample)) -> Vec<(f64, Failed)> {
        let (mut check, mut random, mut last) = (ReadingsCheck::default(), Random::new(4), None);
        let mut found = Vec::new();
        for i in 0..1000 {
            let t = 0.005 * f64::from(i);
            let mut noise = || Vec3::from_fn(|_, _| random.standard_normal());
            let turning = Vec3::new((3.0 * t).sin(), 0.2, (2.0 * t).cos());
            let gyro = turning + noise() * 0.0024;
            let accel =
                Vec3::new((5.0 * t).sin(), (4.0 * t).cos(), 11.0 + 2.0 * (9.0 * t).sin()) + noise() * 0.028;
            let sound = ImuSample::new(Stamp::from_seconds(t), gyro, accel);
            let mut sample = sound;
            if (2.0..2.0 + seconds).contains(&t) {
                change(&mut sample, &last.unwrap_or(sound));
            } else {
                last = Some(sound);
            }
            found.extend(check.test(&sample).map(|failed| (t, failed)));
        }
        found
    }

    #[test]
    fn a_sound_sensor_has_no_faults() {
        assert_eq!(faults(0.0, |_, _| {}), []);
    }

    #[test]
    fn repeated_readings_are_found_with_their_beginning_and_their_end() {
        let hold = |s: &mut ImuSample, last: &ImuSample| (s.gyro, s.accel) = (last.gyro, last.accel);
        let found = faults(0.5, hold);
        let (first, last) = (found[0], found[found.len() - 1]);
        assert!(matches!(first.1.fault, ImuFault::Stuck { .. }) && first.0 < 2.04, "{first:?}");
        // The one that is repeated is the last sound one, or the first wrong one: nobody can tell.
        assert!((first.1.since - Stamp::from_seconds(1.995)).abs() < 1e-9, "{first:?}");
        assert!((last.0 - 2.495).abs() < 1e-9, "{last:?}");
    }

    #[test]
    fn a_dead_half_is_found_while_the_other_goes_on() {
        let found = faults(1.0, |s, _| s.accel = Vec3::zeros());
        assert!(matches!(found[0].1.fault, ImuFault::NoForce { .. }) && found[0].0 < 2.015, "{:?}", found[0]);
        let found = faults(1.0, |s, _| s.gyro = Vec3::zeros());
        assert!(
            matches!(found[0].1.fault, ImuFault::GyroStuck { .. }) && found[0].0 < 2.05,
            "{:?}",
            found[0]
        );
        let found = faults(1.0, |s, last| s.accel = last.accel);
        assert!(matches!(found[0].1.fault, ImuFault::AccelStuck { .. }), "{:?}", found[0]);
    }

    #[test]
    fn readings_beyond_any_sensor_are_found_one_by_one() {
        let found = faults(0.02, |s, _| s.gyro.y = -35.0);
        assert_eq!(found.len(), 4);
        assert!(matches!(found[0].1.fault, ImuFault::OutOfRange { found, .. } if found == -35.0));
        assert!(faults(0.01, |s, _| s.accel.z = f64::NAN).len() == 2);
    }

    /// One reading in ten of an accelerometer is far off by itself; a push that lasts is none of that.
    #[test]
    fn spikes_are_found_one_by_one_and_a_push_is_none() {
        let count = std::cell::Cell::new(0);
        let found = faults(0.5, |s, _| {
            s.accel.x += if count.get() % 10 == 3 { 90.0 } else { 0.0 };
            count.set(count.get() + 1);
        });
        assert_eq!(found.len(), 10, "{found:?}");
        assert!(found.iter().all(|(_, f)| matches!(f.fault, ImuFault::Spike { found, .. } if found > 80.0)));
        // The first reading of either end cannot be told from a spike.
        let pushed = faults(0.5, |s, _| s.accel.x += 90.0);
        assert_eq!(pushed.len(), 2, "{pushed:?}");
    }

    #[test]
    fn a_gap_is_found_when_it_ends() {
        let mut check = ReadingsCheck::default();
        let reading = |t: f64| ImuSample::new(Stamp::from_seconds(t), Vec3::x() * t, Vec3::z() * (9.8 + t));
        assert_eq!([0.0, 0.005, 0.05].map(|t| check.test(&reading(t))), [None; 3]);
        let found = check.test(&reading(0.45)).expect("a gap");
        assert!(matches!(found.fault, ImuFault::Silent { seconds } if (seconds - 0.4).abs() < 1e-9));
    }

    #[test]
    fn a_clock_that_is_moved_leaves_no_gap() {
        let reading = |t: f64| ImuSample::new(Stamp::from_seconds(t), Vec3::x() * t, Vec3::z() * (9.8 + t));
        let found = |moved_s: f64| {
            let mut check = ReadingsCheck::default();
            assert_eq!(check.test(&reading(1.0)), None);
            check.shift(moved_s);
            check.test(&reading(1.0 + 0.116 + 0.016)).map(|failed| failed.fault)
        };
        assert_eq!(found(0.116), None);
        assert!(matches!(found(0.0), Some(ImuFault::Silent { .. })), "without it there is one");
    }

    /// A browser rounds readings to a tenth of a metre and of a degree: on a table they repeat themselves.
    #[test]
    fn a_rounded_sensor_on_a_table_is_not_stuck() {
        let (mut check, mut random) = (ReadingsCheck::default(), Random::new(4));
        let round = |v: Vec3, step: f64| v.map(|v| (v / step).round() * step);
        for i in 0..1200 {
            let t = f64::from(i) / 60.0;
            let mut noise = || Vec3::from_fn(|_, _| random.standard_normal());
            // It is taken up after ten seconds and put down again after five.
            let moved = if (600..900).contains(&i) { (2.0 * t).sin() } else { 0.0 };
            let gyro = round(Vec3::x() * moved + noise() * 0.0005, 0.1f64.to_radians());
            let accel = round(Vec3::new(0.02, moved, 9.83) + noise() * 0.01, 0.1);
            assert_eq!(check.test(&ImuSample::new(Stamp::from_seconds(t), gyro, accel)), None, "{t} s");
        }
    }
}
