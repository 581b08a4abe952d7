//! Zero-velocity detection from the IMU readings alone, with the numbers that show it.
//!
//! The standard deviation of each axis must be little more than the IMU's own noise, the mean turn rate must be the gyro
//! bias, and the mean specific force gravity's: the tests of Skog, Händel, Nilsson, Rantakokko, "Zero-velocity detection" (2010), section III,
//! with bounds for the IMU's true noise, which is several times that of its data sheet.
//!
//! A motion at constant velocity without rotation looks the same to an IMU. Where there is a camera, it must be asked too.

use crate::Bias;
use cairn_geometry::Vec3;
use cairn_sensor::GRAVITY_M_S2;
use cairn_sensor::{ImuNoise, ImuSample};

/// Bounds of what counts as rest.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RestConfig {
    /// Minimum length of readings, seconds.
    pub seconds: f64,
    /// Maximum standard deviation of one axis, in times the white noise at the IMU's rate.
    pub noise_times: f64,
    /// Standard deviation of the gyroscope that always counts as rest, rad/s: an IMU on a floor with people walking about.
    pub gyro_floor: f64,
    /// The same for the accelerometer, m/s^2.
    pub accel_floor: f64,
    /// Maximum mean turn rate that may be the bias while that is unknown, rad/s.
    pub unknown_bias: f64,
    /// Maximum difference of the mean turn rate from the known bias, rad/s.
    pub known_bias: f64,
    /// Maximum difference between the norms of the mean specific force and gravity, m/s^2.
    pub force: f64,
}

impl Default for RestConfig {
    fn default() -> Self {
        Self {
            seconds: 0.5,
            noise_times: 4.0,
            gyro_floor: 0.01,
            accel_floor: 0.1,
            unknown_bias: 0.15,
            known_bias: 0.01,
            force: 0.6,
        }
    }
}

/// Why it is not at rest, with the value found and the bound.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Moves {
    /// Too few readings to decide.
    #[error("{found:.2} s of readings, {need:.2} s are needed")]
    TooShort {
        /// Seconds.
        found: f64,
        /// Seconds.
        need: f64,
    },
    /// The turn rate varies.
    #[error("the turn rate trembles by {found:.4} rad/s, {most:.4} are allowed")]
    Trembles {
        /// Standard deviation of the worst axis, rad/s.
        found: f64,
        /// Bound.
        most: f64,
    },
    /// The specific force varies.
    #[error("the force trembles by {found:.3} m/s^2, {most:.3} are allowed")]
    Shakes {
        /// Standard deviation of the worst axis, m/s^2.
        found: f64,
        /// Bound.
        most: f64,
    },
    /// It turns, or the bias is larger than biases are.
    #[error("it turns by {found:.4} rad/s, {most:.4} are allowed")]
    Turns {
        /// Norm of the mean turn rate off the bias, rad/s.
        found: f64,
        /// Bound.
        most: f64,
    },
    /// The mean force is not gravity's.
    #[error("the mean force is off gravity's by {found:.3} m/s^2, {most:.3} are allowed")]
    Accelerates {
        /// Difference of the norms, m/s^2.
        found: f64,
        /// Bound.
        most: f64,
    },
}

/// Statistics of a stretch of readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rest {
    /// Its length.
    pub seconds: f64,
    /// Mean turn rate, rad/s: the gyroscope's bias when still.
    pub gyro_mean: Vec3,
    /// Mean specific force, m/s^2: against gravity when still.
    pub accel_mean: Vec3,
    /// Standard deviation of the turn rate's worst axis, rad/s.
    pub gyro_deviation: f64,
    /// Standard deviation of the force's worst axis, m/s^2.
    pub accel_deviation: f64,
    /// Why it is not at rest; `None` when it is.
    pub moves: Option<Moves>,
}

impl Rest {
    /// Of readings in time order; `bias` where it is known.
    pub fn of(samples: &[ImuSample], noise: &ImuNoise, bias: Option<&Bias>, config: &RestConfig) -> Self {
        let real = || samples.iter().filter(|s| !s.is_synthesised());
        let n = real().count().max(1) as f64;
        let gyro_mean = real().map(|s| s.gyro).sum::<Vec3>() / n;
        let accel_mean = real().map(|s| s.accel).sum::<Vec3>() / n;
        let spread = |values: &mut dyn Iterator<Item = Vec3>| {
            values.fold(Vec3::zeros(), |sum, v| sum + v.component_mul(&v)).max() / n
        };
        let gyro_deviation = spread(&mut real().map(|s| s.gyro - gyro_mean)).sqrt();
        let accel_deviation = spread(&mut real().map(|s| s.accel - accel_mean)).sqrt();
        let seconds = match (samples.first(), samples.last()) {
            (Some(a), Some(b)) => b.stamp - a.stamp,
            _ => 0.0,
        };
        let rest = Self { seconds, gyro_mean, accel_mean, gyro_deviation, accel_deviation, moves: None };
        Self { moves: rest.judge(n, noise, bias, config), ..rest }
    }

    /// True when it is at rest.
    pub fn is_still(&self) -> bool {
        self.moves.is_none()
    }

    /// The direction of free fall in the sensor's frame, of length one, and its standard deviation in radians when the
    /// accelerometer's bias has the deviation `accel_bias_sigma` (m/s^2); `None` when it moves.
    pub fn down(&self, accel_bias_sigma: f64) -> Option<(Vec3, f64)> {
        let down = -self.accel_mean.try_normalize(1.0).filter(|_| self.is_still())?;
        Some((down, accel_bias_sigma / GRAVITY_M_S2))
    }

    fn judge(&self, n: f64, noise: &ImuNoise, bias: Option<&Bias>, s: &RestConfig) -> Option<Moves> {
        if self.seconds < s.seconds || n < 10.0 {
            return Some(Moves::TooShort { found: self.seconds, need: s.seconds });
        }
        let root = (n / self.seconds).sqrt();
        let most = (s.noise_times * noise.gyro * root).max(s.gyro_floor);
        if over(self.gyro_deviation, most) {
            return Some(Moves::Trembles { found: self.gyro_deviation, most });
        }
        let most = (s.noise_times * noise.accel * root).max(s.accel_floor);
        if over(self.accel_deviation, most) {
            return Some(Moves::Shakes { found: self.accel_deviation, most });
        }
        let (turn, most) = match bias {
            Some(b) => ((self.gyro_mean - b.gyro).norm(), s.known_bias),
            None => (self.gyro_mean.norm(), s.unknown_bias),
        };
        if over(turn, most) {
            return Some(Moves::Turns { found: turn, most });
        }
        let force = self.accel_mean - bias.map_or(Vec3::zeros(), |b| b.accel);
        let found = (force.norm() - GRAVITY_M_S2).abs();
        over(found, s.force).then_some(Moves::Accelerates { found, most: s.force })
    }
}

/// More than the bound, or NaN.
fn over(found: f64, most: f64) -> bool {
    found.is_nan() || found > most
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;
    use cairn_sensor::Stamp;

    const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 1.9e-5, accel: 2.0e-3, accel_walk: 3.0e-3 };

    fn samples(n: usize, mut change: impl FnMut(f64, &mut ImuSample)) -> Vec<ImuSample> {
        let mut rng = Random::new(2);
        let mut vector =
            move |s: f64| Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s;
        let root = 200f64.sqrt();
        (0..n)
            .map(|i| {
                let t = i as f64 / 200.0;
                let gyro = Vec3::new(0.0, 0.02, 0.08) + vector(NOISE.gyro * root);
                let accel = Vec3::new(9.2, 0.1, -3.0) + vector(NOISE.accel * root);
                let mut s = ImuSample::new(Stamp::from_seconds(t), gyro, accel);
                change(t, &mut s);
                s
            })
            .collect()
    }

    fn moves(n: usize, bias: Option<Bias>, change: impl FnMut(f64, &mut ImuSample)) -> Option<Moves> {
        Rest::of(&samples(n, change), &NOISE, bias.as_ref(), &RestConfig::default()).moves
    }

    #[test]
    fn detects_rest_and_names_every_motion() {
        let known = Bias { gyro: Vec3::new(0.0, 0.02, 0.08), accel: Vec3::zeros() };
        assert_eq!(moves(120, None, |_, _| {}), None);
        assert_eq!(moves(120, Some(known), |_, _| {}), None);
        assert!(matches!(moves(60, None, |_, _| {}), Some(Moves::TooShort { .. })));
        assert!(matches!(
            moves(200, None, |t, s| s.gyro.x += 0.05 * (9.0 * t).sin()),
            Some(Moves::Trembles { .. })
        ));
        assert!(matches!(
            moves(200, None, |t, s| s.accel.y += 0.5 * (9.0 * t).sin()),
            Some(Moves::Shakes { .. })
        ));
        assert!(matches!(moves(200, Some(known), |_, s| s.gyro.x += 0.02), Some(Moves::Turns { .. })));
        assert!(matches!(moves(200, None, |_, s| s.gyro.x += 0.3), Some(Moves::Turns { .. })));
        assert!(matches!(moves(200, None, |_, s| s.accel *= 1.1), Some(Moves::Accelerates { .. })));
        assert!(moves(200, None, |_, s| s.gyro.x = f64::NAN).is_some(), "no number is no rest");
    }

    #[test]
    fn means_at_rest_are_gravity_and_bias() {
        let rest = Rest::of(&samples(400, |_, _| {}), &NOISE, None, &RestConfig::default());
        let (down, sigma) = rest.down(0.1).unwrap();
        assert!((rest.gyro_mean - Vec3::new(0.0, 0.02, 0.08)).norm() < 1e-3);
        assert!(down.angle(&-Vec3::new(9.2, 0.1, -3.0)) < 1e-3 && (sigma - 0.0102).abs() < 1e-4);
        assert!(Rest::of(&[], &NOISE, None, &RestConfig::default()).down(0.1).is_none());
    }
}
