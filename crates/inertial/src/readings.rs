//! Statistics of a stretch of IMU readings: rate, holes, norms, units. For calibration checks and at start-up.

use crate::{Moves, Rest, RestConfig};
use cairn_geometry::Vec3;
use cairn_sensor::{GRAVITY_M_S2, ImuSample, ImuSensor};

/// Length of a piece that is examined on its own, seconds.
const PIECE_S: f64 = 0.5;
/// Minimum rate, samples a second: browsers give 60 and not more, with some jitter.
const LEAST_RATE_HZ: f64 = 55.0;
/// How far the rate may be off the one stated.
const RATE_OFF: f64 = 0.1;
/// How far the norm at rest may be off gravity's, m/s^2: a bias of a MEMS accelerometer on every axis.
const REST_OFF: f64 = 0.5;
/// How far the median norm in motion may be off.
const MOTION_OFF: f64 = 1.5;
/// Below it the accelerometer's median norm may be a gyroscope's, m/s^2 or rad/s: hands turn by up to 3 rad/s, the test walks
/// (two seconds at rest, eight of nodding and turning) by 1.
const LEAST_FORCE: f64 = 4.0;
/// How much farther than the direction of the specific force the gyroscope may turn. For a hand-held IMU it is about one; on a
/// quadrotor the thrust turns along, which makes it 3 to 12; readings in degrees turn 57 times as far.
const MOST_TURN_RATIO: f64 = 25.0;
/// Neither hands nor small aircraft turn faster, rad/s: the end of the range of most gyroscopes.
const FASTEST: f64 = 40.0;

/// What is doubtful about readings, with the number that shows it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Doubt {
    /// The sensor is slow.
    #[error(
        "the IMU gives {found:.1} samples a second, at least {LEAST_RATE_HZ} are needed for hand-held motion"
    )]
    Slow {
        /// Samples a second.
        found: f64,
    },
    /// It gives another rate than the rig says.
    #[error("the IMU gives {found:.1} samples a second, the rig says {stated:.1}")]
    Rate {
        /// Samples a second.
        found: f64,
        /// As the rig has it.
        stated: f64,
    },
    /// Samples are missing.
    #[error("{missing:.1} % of the IMU's samples are missing, for {longest_s:.3} s at most")]
    Holes {
        /// Percent.
        missing: f64,
        /// The longest hole, seconds.
        longest_s: f64,
    },
    /// At rest the accelerometer does not read gravity.
    #[error("at rest the accelerometer reads {found:.3} m/s^2, gravity is 9.81{}", unit(*.found))]
    RestNorm {
        /// Mean norm at rest, m/s^2.
        found: f64,
    },
    /// Never at rest, and in motion the accelerometer reads something else than about gravity.
    #[error("the accelerometer reads {found:.3} m/s^2 in the middle, gravity is 9.81{}", unit(*.found))]
    Norm {
        /// Median norm, m/s^2.
        found: f64,
    },
    /// The gyroscope turns much more than the direction of the force.
    #[error(
        "the gyroscope turns {ratio:.0} times as far as the force's direction, up to {fastest:.1} rad/s: is it in degrees?"
    )]
    Degrees {
        /// Turned by the gyroscope over turned by the force.
        ratio: f64,
        /// Greatest turn rate.
        fastest: f64,
    },
    /// The gyroscope reads gravity.
    #[error(
        "the gyroscope reads {gyro:.2} rad/s in the middle, the accelerometer {accel:.2} m/s^2: are they exchanged?"
    )]
    Exchanged {
        /// Median norm of the gyroscope, rad/s.
        gyro: f64,
        /// Median norm of the accelerometer, m/s^2.
        accel: f64,
    },
    /// The readings never change.
    #[error("the readings never change: the sensor is not running")]
    Frozen,
}

fn unit(norm: f64) -> &'static str {
    if (norm - 1.0).abs() < 0.1 {
        ": is it in g?"
    } else if norm < 1.5 {
        ": is gravity taken off already? it must stay in"
    } else {
        ""
    }
}

/// Figures of a stretch of readings.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Readings {
    /// Samples.
    pub samples: usize,
    /// Seconds from the first to the last.
    pub seconds: f64,
    /// Samples a second, by the median step.
    pub rate_hz: f64,
    /// The longest step.
    pub longest_s: f64,
    /// Percent of the samples that are missing at that rate.
    pub missing_percent: f64,
    /// Median norm of the accelerometer, m/s^2.
    pub norm: f64,
    /// Median norm of the gyroscope, rad/s.
    pub gyro_norm: f64,
    /// Seconds at rest.
    pub rest_s: f64,
    /// Mean norm of the accelerometer at rest, m/s^2; none where it never rests.
    pub rest_norm: Option<f64>,
    /// How far the gyroscope turns about horizontal axes over how far the force's direction turns; none where neither does.
    pub turn_ratio: Option<f64>,
    /// Greatest turn rate, rad/s.
    pub fastest: f64,
    /// Whether all readings are the same.
    pub frozen: bool,
}

impl Readings {
    /// Of samples in time order.
    pub fn of(samples: &[ImuSample], sensor: &ImuSensor) -> Self {
        let (Some(first), Some(last)) = (samples.first(), samples.last()) else { return Self::default() };
        let mut steps: Vec<f64> = samples.windows(2).map(|w| w[1].stamp - w[0].stamp).collect();
        steps.sort_by(f64::total_cmp);
        let step = steps.get(steps.len() / 2).copied().unwrap_or(0.0);
        let lost: f64 = steps.iter().map(|s| (s / step).round().max(1.0) - 1.0).sum();
        let (rest_s, rest_norm) = at_rest(samples, sensor);
        Self {
            samples: samples.len(),
            seconds: last.stamp - first.stamp,
            rate_hz: if step > 0.0 { 1.0 / step } else { 0.0 },
            longest_s: steps.last().copied().unwrap_or(0.0),
            missing_percent: 100.0 * lost / (lost + samples.len() as f64),
            norm: median(samples.iter().map(|s| s.accel.norm())),
            gyro_norm: median(samples.iter().map(|s| s.gyro.norm())),
            rest_s,
            rest_norm,
            turn_ratio: turn_ratio(samples),
            fastest: samples.iter().map(|s| s.gyro.norm()).fold(0.0, f64::max),
            frozen: samples.len() > 10
                && samples.iter().all(|s| s.gyro == first.gyro && s.accel == first.accel),
        }
    }

    /// What is doubtful about them.
    pub fn doubts(&self, sensor: &ImuSensor) -> Vec<Doubt> {
        let mut out = Vec::new();
        if self.samples < 2 {
            return out;
        }
        if self.rate_hz < LEAST_RATE_HZ {
            out.push(Doubt::Slow { found: self.rate_hz });
        }
        if (self.rate_hz / sensor.rate_hz - 1.0).abs() > RATE_OFF {
            out.push(Doubt::Rate { found: self.rate_hz, stated: sensor.rate_hz });
        }
        if self.missing_percent > 1.0 || self.longest_s > 0.1 {
            out.push(Doubt::Holes { missing: self.missing_percent, longest_s: self.longest_s });
        }
        if (self.gyro_norm - GRAVITY_M_S2).abs() < MOTION_OFF && self.norm < LEAST_FORCE {
            out.push(Doubt::Exchanged { gyro: self.gyro_norm, accel: self.norm });
            return out;
        }
        match self.rest_norm {
            Some(found) if (found - GRAVITY_M_S2).abs() > REST_OFF => out.push(Doubt::RestNorm { found }),
            None if (self.norm - GRAVITY_M_S2).abs() > MOTION_OFF => {
                out.push(Doubt::Norm { found: self.norm });
            }
            _ => {}
        }
        let ratio = self.turn_ratio.unwrap_or(0.0);
        if ratio > MOST_TURN_RATIO || self.fastest > FASTEST {
            out.push(Doubt::Degrees { ratio, fastest: self.fastest });
        }
        if self.frozen {
            out.push(Doubt::Frozen);
        }
        out
    }
}

/// The middle of some numbers; 0 without any.
fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

fn pieces(samples: &[ImuSample]) -> impl Iterator<Item = &[ImuSample]> {
    let mut rest = samples;
    std::iter::from_fn(move || {
        let first = rest.first()?;
        let n = rest.partition_point(|s| s.stamp - first.stamp < PIECE_S);
        let (piece, after) = rest.split_at(n.max(1));
        rest = after;
        Some(piece)
    })
}

/// Seconds at rest and the mean norm there. Units may be wrong: only the variation is tested, relative to the norm.
fn at_rest(samples: &[ImuSample], sensor: &ImuSensor) -> (f64, Option<f64>) {
    let config = RestConfig { seconds: 0.8 * PIECE_S, ..Default::default() };
    let (mut seconds, mut sum) = (0.0, 0.0);
    for piece in pieces(samples) {
        let rest = Rest::of(piece, &sensor.noise, None, &config);
        let still = matches!(rest.moves, None | Some(Moves::Accelerates { .. } | Moves::Turns { .. }));
        if still && rest.gyro_mean.norm() < 10.0 * config.unknown_bias {
            seconds += rest.seconds;
            sum += rest.seconds * rest.accel_mean.norm();
        }
    }
    (seconds, (seconds > 0.9 * PIECE_S).then(|| sum / seconds))
}

/// Over pieces in which the gyroscope turns by more than a tenth of a radian about axes across the specific force.
fn turn_ratio(samples: &[ImuSample]) -> Option<f64> {
    let n = samples.len().max(1) as f64;
    let mean = samples.iter().map(|s| s.gyro).sum::<Vec3>() / n;
    let (mut integrated, mut seen) = (0.0, 0.0);
    let force = |half: &[ImuSample]| half.iter().map(|s| s.accel).sum::<Vec3>().try_normalize(1e-6);
    for piece in pieces(samples).filter(|p| p.len() >= 8) {
        let (a, b) = piece.split_at(piece.len() / 2);
        let (Some(before), Some(after)) = (force(a), force(b)) else { continue };
        let seconds = 0.5 * (piece[piece.len() - 1].stamp - piece[0].stamp);
        // From the middle of the first half to that of the second.
        let middle = &piece[piece.len() / 4..3 * piece.len() / 4];
        let rate = middle.iter().map(|s| s.gyro).sum::<Vec3>() / middle.len() as f64 - mean;
        let across = rate - before * rate.dot(&before);
        let turned = across.norm() * seconds;
        if turned > 0.1 {
            integrated += turned;
            seen += before.angle(&after);
        }
    }
    (integrated > 0.0).then(|| integrated / seen.max(1e-3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se3, So3};
    use cairn_random::Random;
    use cairn_sensor::{ImuNoise, Stamp};

    fn sensor() -> ImuSensor {
        let noise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };
        ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise, offset_s: 0.0 }
    }

    /// Two seconds at rest, then eight of nodding and turning.
    fn samples(rate: f64, change: impl Fn(&mut ImuSample)) -> Vec<ImuSample> {
        let mut rng = Random::new(1);
        let rotation = |t: f64| {
            let t = (t - 2.0).max(0.0);
            So3::exp(&(Vec3::z() * (0.9 * t))) * So3::exp(&(Vec3::x() * (0.6 * (1.9 * t).sin())))
        };
        (0..(10.0 * rate) as usize)
            .map(|i| {
                let t = i as f64 / rate;
                let mut vector = |s: f64| {
                    Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s
                };
                let gyro = (rotation(t - 5e-5).inverse() * rotation(t + 5e-5)).log() / 1e-4;
                let accel =
                    rotation(t).inverse() * Vec3::new(0.5 * (3.0 * (t - 2.0).max(0.0)).sin(), 0.0, 9.81);
                let mut s = ImuSample::new(
                    Stamp::from_seconds(t),
                    gyro + Vec3::new(0.0, 0.02, 0.08) + vector(0.0024),
                    accel + vector(0.028),
                );
                change(&mut s);
                s
            })
            .collect()
    }

    fn doubts(samples: &[ImuSample]) -> Vec<Doubt> {
        Readings::of(samples, &sensor()).doubts(&sensor())
    }

    #[test]
    fn good_readings_have_no_doubts() {
        let r = Readings::of(&samples(200.0, |_| {}), &sensor());
        assert_eq!(r.doubts(&sensor()), [], "{r:?}");
        assert!((r.rest_norm.unwrap() - 9.81).abs() < 0.02 && (1.0..3.0).contains(&r.rest_s), "{r:?}");
        assert!(r.turn_ratio.unwrap() < 2.0 && (r.rate_hz - 200.0).abs() < 0.1, "{r:?}");
        assert_eq!(doubts(&[]), []);
    }

    #[test]
    fn wrong_units_are_found_in_motion_and_at_rest() {
        let degrees = |s: &mut ImuSample| s.gyro *= 57.29578;
        assert!(matches!(doubts(&samples(200.0, degrees))[..], [Doubt::Degrees { .. }]));
        // Slow motion in degrees: no rate is impossible by itself.
        let slow: Vec<ImuSample> = samples(200.0, degrees)
            .into_iter()
            .map(|s| ImuSample { stamp: Stamp(s.stamp.0 * 5), gyro: s.gyro / 5.0, ..s })
            .collect();
        let slow_sensor = ImuSensor { rate_hz: 40.0, ..sensor() };
        let found = Readings::of(&slow, &slow_sensor).doubts(&slow_sensor);
        assert!(
            found.iter().any(|d| matches!(d, Doubt::Degrees { ratio, .. } if *ratio > 20.0)),
            "{found:?}"
        );
        let in_g = |s: &mut ImuSample| s.accel /= 9.81;
        let text = doubts(&samples(200.0, in_g)).iter().map(Doubt::to_string).collect::<String>();
        assert!(text.contains("is it in g?"), "{text}");
        let exchanged = doubts(&samples(200.0, |s| (s.gyro, s.accel) = (s.accel, s.gyro)));
        assert!(
            matches!(exchanged[..], [Doubt::Exchanged { gyro, .. }] if (gyro - 9.81).abs() < 0.1),
            "{exchanged:?}"
        );
        let found = doubts(&samples(200.0, |s| s.accel *= 1.1));
        assert!(
            matches!(found[..], [Doubt::RestNorm { found }] if (found - 10.79).abs() < 0.02),
            "{found:?}"
        );
    }

    #[test]
    fn reports_rates_and_holes() {
        assert!(matches!(doubts(&samples(50.0, |_| {}))[..], [Doubt::Slow { .. }, Doubt::Rate { .. }]));
        let mut holes = samples(200.0, |_| {});
        holes.drain(700..760);
        assert!(
            matches!(doubts(&holes)[..], [Doubt::Holes { longest_s, .. }] if (longest_s - 0.305).abs() < 1e-6)
        );
        let frozen = samples(200.0, |s| (s.gyro, s.accel) = (Vec3::zeros(), Vec3::z() * 9.8));
        assert_eq!(doubts(&frozen), [Doubt::Frozen]);
    }
}
