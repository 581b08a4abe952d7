//! A recorded motion with its recorded IMU readings: the camera's poses smoothed and transformed to the readings'
//! clock.
//!
//! Input: measured body poses (markers, a tracker: noisy, with gaps, with a clock of their own) and the real readings.
//! Output: a [`ContinuousTrajectory`] that can be evaluated at any time, and how well the two agree. What is faster than a fraction
//! of a second comes from the readings, what is slower from the poses: the readings are integrated over the whole
//! recording, the difference to the poses is slow, and is smoothed by robust local quadratics (Cleveland, "Robust
//! locally weighted regression", 1979). A bias, the direction of gravity and the accelerometer's zero offset are all
//! in that slow difference. So are errors of the readings that are slower than the windows below: those remain, which
//! is intended.

use super::ContinuousTrajectory;
use cairn_geometry::{Mat3, Se3, So3, Vec3};
use cairn_sensor::{ImuSample, SourceError, Stamp};
use nalgebra::{SMatrix, SVector};

/// Standard deviation of the window for rotations, seconds.
const TURN_WINDOW_S: f64 = 1.0;
/// Standard deviation of the window for positions, seconds.
const PLACE_WINDOW_S: f64 = 0.15;
/// Poses are compared with the gyroscope over this time to find the clock offset and the axes.
const STEP_S: f64 = 0.2;
/// How many times poses that lie far from the smoothed ones are weighted down.
const ROBUST_ROUNDS: usize = 2;
/// How many times clock offset and axes are estimated again after smoothing.
const CLOCK_ROUNDS: usize = 3;
/// Interval over which poses and readings are compared in the end: about that of the images.
const COMPARE_S: f64 = 0.05;
/// The largest clock offset that is accepted, seconds.
const MOST_OFFSET_S: f64 = 0.1;
const GRAVITY: Vec3 = Vec3::new(0.0, 0.0, -cairn_sensor::GRAVITY_M_S2);

/// How well measured poses and readings agree, before and after smoothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Agreement {
    /// Seconds added to the poses' stamps.
    pub offset_s: f64,
    /// Angle of the removed misalignment between the poses' body frame and the readings' axes, radians.
    pub misaligned_rad: f64,
    /// The gyroscope's mean bias, rad/s.
    pub gyro_bias: Vec3,
    /// Difference between the poses' rotation and the gyroscope's without its mean bias over 50 ms, root mean square in
    /// radians: as measured, smoothed.
    pub turn_rms: [f64; 2],
    /// Acceleration of the poses against the accelerometer's, likewise, m/s^2.
    pub acceleration_rms: [f64; 2],
    /// How far smoothing moved a pose: root mean square and maximum, metres.
    pub moved_m: [f64; 2],
    /// How far it rotated a pose, likewise, radians.
    pub turned_rad: [f64; 2],
    /// The longest gap in the poses, which the readings bridge, seconds.
    pub longest_hole_s: f64,
}

/// The motion that is rendered.
pub(crate) struct Recorded {
    /// Time 0 is `epoch`.
    pub motion: ContinuousTrajectory,
    pub epoch: Stamp,
    pub agreement: Agreement,
}

/// Measured poses, corrected and with times in seconds.
struct Measured {
    times: Vec<f64>,
    poses: Vec<Se3>,
}

impl Recorded {
    /// From measured `world_from_body` (z up) and readings whose axes are about the body's.
    ///
    /// # Errors
    /// When the two do not overlap for two seconds.
    pub fn new(poses: &[(Stamp, Se3)], readings: &[ImuSample]) -> Result<Self, SourceError> {
        let fail = |why: &str| {
            let cure = "give poses and readings of the same motion, in one clock and by increasing time";
            Err(SourceError::new("trajectory and imu", why, cure))
        };
        let (Some(first), Some(last)) = (readings.first(), readings.last()) else {
            return fail("there are no readings");
        };
        let inside = |t: Stamp| t - first.stamp > MOST_OFFSET_S && last.stamp - t > MOST_OFFSET_S;
        let poses: Vec<_> = poses.iter().filter(|(t, _)| inside(*t)).copied().collect();
        if poses.len() < 20 || poses[poses.len() - 1].0 - poses[0].0 < 2.0 {
            return fail("they overlap by less than two seconds");
        }
        let raw = ContinuousTrajectory::through(&poses)?;
        let times: Vec<f64> = readings.iter().map(|s| s.stamp - first.stamp).collect();
        let sums = Sums::of_rotation(&times, readings, &Vec3::zeros());
        let measured = Measured {
            times: poses.iter().map(|p| p.0 - first.stamp).collect(),
            poses: poses.iter().map(|p| p.1).collect(),
        };
        let Some(mut clock) = Clock::find(&measured, &sums) else {
            return fail("the readings rotate differently from the poses");
        };
        let mut measured = clock.correct(measured);
        let mut smooth = Smooth::of(&measured, &times, readings, &clock.bias);
        // With the noise of the poses removed, the clock offset is found more accurately.
        for _ in 0..CLOCK_ROUNDS {
            let poses = Measured { times: times[smooth.range.clone()].to_vec(), poses: smooth.poses.clone() };
            let Some(left) = Clock::find(&poses, &sums) else { break };
            measured = left.correct(measured);
            clock = clock.then(&left);
            smooth = Smooth::of(&measured, &times, readings, &clock.bias);
        }
        let (from, to) = (smooth.range.start, smooth.range.end);
        let stamped: Vec<(Stamp, Se3)> =
            readings[from..to].iter().map(|s| s.stamp).zip(smooth.poses.iter().copied()).collect();
        let motion = ContinuousTrajectory::through(&stamped)?;
        let epoch = stamped[0].0;
        // Time 0 of the raw motion is its first pose, in the poses' clock.
        let raw_at = poses[0].0 - epoch;
        let agreement = agreement(
            &clock,
            &measured,
            &motion,
            &raw.shifted(raw_at),
            epoch,
            first.stamp,
            &readings[from..to],
        );
        Ok(Self { motion, epoch, agreement })
    }
}

/// Smoothed poses, at each reading of a range.
struct Smooth {
    range: std::ops::Range<usize>,
    poses: Vec<Se3>,
}

impl Smooth {
    fn of(m: &Measured, times: &[f64], readings: &[ImuSample], bias: &Vec3) -> Self {
        let sums = Sums::of_rotation(times, readings, bias);
        let from = times.partition_point(|t| *t < m.times[0]);
        let to = times.partition_point(|t| *t <= m.times[m.times.len() - 1]);
        let rotations = smooth_rotations(m, &sums, from..to);
        let places = smooth_places(m, &times[from..to], &readings[from..to], &rotations);
        let poses = rotations.iter().zip(&places).map(|(r, p)| Se3::new(*r, *p)).collect();
        Self { range: from..to, poses }
    }
}

/// The gyroscope's readings integrated from the first one on.
struct Sums<'a> {
    times: &'a [f64],
    gyro: Vec<Vec3>,
    rotations: Vec<So3>,
}

impl<'a> Sums<'a> {
    fn of_rotation(times: &'a [f64], readings: &[ImuSample], bias: &Vec3) -> Self {
        let mut rotations = vec![So3::identity()];
        for (w, t) in readings.windows(2).zip(times.windows(2)) {
            let turned = So3::exp(&(((w[0].gyro + w[1].gyro) * 0.5 - bias) * (t[1] - t[0])));
            rotations.push(rotations[rotations.len() - 1] * turned);
        }
        Self { times, gyro: readings.iter().map(|s| s.gyro).collect(), rotations }
    }

    /// Index of the reading before a time and the fraction of the way to the next, 0 to 1.
    fn place(&self, t: f64) -> (usize, f64) {
        let i = self.times.partition_point(|v| *v <= t).clamp(1, self.times.len() - 1);
        (i - 1, ((t - self.times[i - 1]) / (self.times[i] - self.times[i - 1])).clamp(0.0, 1.0))
    }

    fn rotation(&self, t: f64) -> So3 {
        let (i, k) = self.place(t);
        self.rotations[i].interpolate(&self.rotations[i + 1], k)
    }

    /// The mean rate within 15 ms of a time.
    fn rate(&self, t: f64) -> Vec3 {
        let from = self.times.partition_point(|v| *v < t - 0.015);
        let to = self.times.partition_point(|v| *v <= t + 0.015).max(from + 1).min(self.gyro.len());
        self.gyro[from..to].iter().sum::<Vec3>() / (to - from).max(1) as f64
    }
}

/// The differences between the poses and the readings: clock offset, axes, mean bias.
struct Clock {
    offset_s: f64,
    misaligned: Vec3,
    bias: Vec3,
}

impl Clock {
    /// Linear least squares over steps between poses. Where the readings integrate to `D` over a step of `h` seconds,
    /// between rates `w0` and `w1`, the poses rotate by `D` and then by
    /// `offset (w1 - D'w0) + (misaligned - D'misaligned) - h Jr bias`. Steps that jump are weighted down (Huber).
    fn find(m: &Measured, sums: &Sums) -> Option<Self> {
        let mut steps: Vec<(SMatrix<f64, 3, 7>, Vec3)> = Vec::new();
        let mut i = 0;
        while i + 1 < m.times.len() {
            let j = m.times.partition_point(|t| *t < m.times[i] + STEP_S);
            if j >= m.times.len() {
                break;
            }
            let (t0, t1) = (m.times[i], m.times[j]);
            if t1 - t0 < 2.0 * STEP_S {
                let turned = sums.rotation(t0).inverse() * sums.rotation(t1);
                let by_poses = m.poses[i].rotation.inverse() * m.poses[j].rotation;
                let back = turned.inverse();
                let mut row = SMatrix::<f64, 3, 7>::zeros();
                row.fixed_view_mut::<3, 1>(0, 0).copy_from(&(sums.rate(t1) - back * sums.rate(t0)));
                row.fixed_view_mut::<3, 3>(0, 1).copy_from(&(Mat3::identity() - back.matrix()));
                let of_bias = So3::right_jacobian(&turned.log()) * -(t1 - t0);
                row.fixed_view_mut::<3, 3>(0, 4).copy_from(&of_bias);
                steps.push((row, (back * by_poses).log()));
            }
            i = j;
        }
        let mut x = SVector::<f64, 7>::zeros();
        for _ in 0..8 {
            let mut off: Vec<f64> = steps.iter().map(|(a, b)| (b - a * x).norm()).collect();
            let weights: Vec<f64> = {
                let mut sorted = off.clone();
                sorted.sort_by(f64::total_cmp);
                let most = 1.5 * sorted.get(sorted.len() / 2)?.max(1e-9);
                off.drain(..).map(|v| (most / v.max(1e-12)).min(1.0)).collect()
            };
            let mut normal = SMatrix::<f64, 7, 7>::identity() * 1e-9;
            let mut right = SVector::<f64, 7>::zeros();
            for ((a, b), w) in steps.iter().zip(&weights) {
                normal += a.transpose() * a * *w;
                right += a.transpose() * b * *w;
            }
            x = normal.cholesky()?.solve(&right);
        }
        let found = Self {
            offset_s: x[0],
            misaligned: x.fixed_rows::<3>(1).into_owned(),
            bias: x.fixed_rows::<3>(4).into_owned(),
        };
        // Half a radian and a tenth of a second are too large as corrections of a linear model.
        (found.offset_s.abs() < MOST_OFFSET_S && found.misaligned.norm() < 0.5).then_some(found)
    }

    /// The composition with what was found after this one.
    fn then(&self, left: &Self) -> Self {
        let misaligned = (So3::exp(&self.misaligned) * So3::exp(&left.misaligned)).log();
        Self { offset_s: self.offset_s + left.offset_s, misaligned, bias: left.bias }
    }

    fn correct(&self, mut m: Measured) -> Measured {
        m.times.iter_mut().for_each(|t| *t += self.offset_s);
        let back = So3::exp(&-self.misaligned);
        m.poses.iter_mut().for_each(|p| *p = Se3::new(p.rotation * back, p.translation));
        m
    }
}

/// Tukey weights of residuals: zero beyond six times the median distance.
fn tukey(off: &[f64]) -> Vec<f64> {
    let mut sorted = off.to_vec();
    sorted.sort_by(f64::total_cmp);
    let most = 6.0 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0).max(1e-9);
    off.iter().map(|v| (1.0 - (v / most).powi(2)).max(0.0).powi(2)).collect()
}

/// At each reading: the gyroscope's integral rotated by the smoothed difference to the poses.
fn smooth_rotations(m: &Measured, sums: &Sums, range: std::ops::Range<usize>) -> Vec<So3> {
    let windows = Windows::new(&m.times, TURN_WINDOW_S);
    let off: Vec<So3> =
        m.times.iter().zip(&m.poses).map(|(t, p)| p.rotation * sums.rotation(*t).inverse()).collect();
    let smoothed = |t: f64, weights: &[f64]| {
        // Logarithms are taken about a nearby difference with full weight.
        let after = m.times.partition_point(|v| *v < t).min(off.len() - 1);
        let near = (after..off.len()).chain((0..after).rev()).find(|k| weights[*k] > 0.3).unwrap_or(after);
        let value = |k: usize| (off[k] * off[near].inverse()).log();
        So3::exp(&local_quadratic(&m.times, value, weights, t, windows.at(t))) * off[near]
    };
    let mut weights = vec![1.0; off.len()];
    for _ in 0..ROBUST_ROUNDS {
        let far = |(t, o): (&f64, &So3)| (smoothed(*t, &weights).inverse() * *o).angle();
        weights = tukey(&m.times.iter().zip(&off).map(far).collect::<Vec<f64>>());
    }
    range.map(|i| smoothed(sums.times[i], &weights) * sums.rotations[i]).collect()
}

/// At each reading: the twice integrated accelerometer moved by the smoothed difference to the poses.
fn smooth_places(m: &Measured, times: &[f64], readings: &[ImuSample], rotations: &[So3]) -> Vec<Vec3> {
    let force = |i: usize| rotations[i] * readings[i].accel + GRAVITY;
    let (mut summed, mut velocity) = (vec![Vec3::zeros()], Vec3::zeros());
    for i in 1..times.len() {
        let (h, a, b) = (times[i] - times[i - 1], force(i - 1), force(i));
        summed.push(summed[i - 1] + velocity * h + (a * 2.0 + b) * (h * h / 6.0));
        velocity += (a + b) * (0.5 * h);
    }
    let at = |t: f64| {
        let i = times.partition_point(|v| *v <= t).clamp(1, times.len() - 1);
        let k = ((t - times[i - 1]) / (times[i] - times[i - 1])).clamp(0.0, 1.0);
        summed[i - 1] * (1.0 - k) + summed[i] * k
    };
    let windows = Windows::new(&m.times, PLACE_WINDOW_S);
    let off: Vec<Vec3> = m.times.iter().zip(&m.poses).map(|(t, p)| p.translation - at(*t)).collect();
    // Position measurements do not jump as rotations do.
    let weights = vec![1.0; off.len()];
    let smoothed = |t: f64| local_quadratic(&m.times, |k| off[k], &weights, t, windows.at(t));
    times.iter().zip(&summed).map(|(t, s)| s + smoothed(*t)).collect()
}

/// Windows that grow where there are gaps, continuously in time.
struct Windows {
    least_s: f64,
    holes: Vec<[f64; 2]>,
}

impl Windows {
    fn new(times: &[f64], least_s: f64) -> Self {
        let holes = times.windows(2).map(|w| [w[0], w[1]]).filter(|w| w[1] - w[0] > least_s).collect();
        Self { least_s, holes }
    }

    fn at(&self, t: f64) -> f64 {
        let over = |[a, b]: &[f64; 2]| 0.6 * (b - a) - 0.5 * (a - t).max(t - b).max(0.0);
        self.holes.iter().map(over).fold(self.least_s, f64::max)
    }
}

/// The value at `t` of the quadratic that fits best around it with Gaussian weights, times those given.
fn local_quadratic(
    times: &[f64],
    value: impl Fn(usize) -> Vec3,
    weights: &[f64],
    t: f64,
    sigma: f64,
) -> Vec3 {
    // Farther away a weight is below 4e-4, and a pose more or less has no effect.
    let from = times.partition_point(|v| *v < t - 4.0 * sigma);
    let to = times.partition_point(|v| *v <= t + 4.0 * sigma);
    let (mut normal, mut right) = (Mat3::zeros(), Mat3::zeros());
    for k in from..to {
        let u = (times[k] - t) / sigma;
        let w = (-0.5 * u * u).exp() * weights[k];
        let row = Vec3::new(1.0, u, u * u);
        normal += row * row.transpose() * w;
        right += row * value(k).transpose() * w;
    }
    match normal.cholesky() {
        Some(factor) => factor.solve(&right).row(0).transpose(),
        None => value(times.partition_point(|v| *v < t).min(times.len().saturating_sub(1))),
    }
}

fn agreement(
    clock: &Clock,
    measured: &Measured,
    smooth: &ContinuousTrajectory,
    raw: &ContinuousTrajectory,
    epoch: Stamp,
    origin: Stamp,
    readings: &[ImuSample],
) -> Agreement {
    let times: Vec<f64> = readings.iter().map(|s| s.stamp - epoch).collect();
    let sums = Sums::of_rotation(&times, readings, &clock.bias);
    let rms = |motion: &ContinuousTrajectory, shift: f64| {
        let (mut turn, mut acceleration) = (0.0, 0.0);
        for (t, s) in times.iter().zip(readings) {
            let state = motion.state(t - shift);
            let next = (t + COMPARE_S).min(times[times.len() - 1]);
            let by_poses = state.world_from_body.rotation.inverse() * motion.pose(next - shift).rotation;
            let by_gyro = sums.rotation(*t).inverse() * sums.rotation(next);
            turn += (by_gyro.inverse() * by_poses).angle().powi(2);
            let force = state.world_from_body.rotation * s.accel + GRAVITY;
            acceleration += (state.acceleration - force).norm_squared();
        }
        let n = times.len() as f64;
        [f64::sqrt(turn / n), f64::sqrt(acceleration / n)]
    };
    let ([turn0, acc0], [turn1, acc1]) = (rms(raw, clock.offset_s), rms(smooth, 0.0));
    let (mut moved, mut turned) = ([0.0, 0.0f64], [0.0, 0.0f64]);
    for (t, pose) in measured.times.iter().zip(&measured.poses) {
        let t = *t - (epoch - origin);
        if t < smooth.start() || t > smooth.end() {
            continue;
        }
        let at = smooth.pose(t);
        let (d, a) =
            ((at.translation - pose.translation).norm(), (at.rotation.inverse() * pose.rotation).angle());
        moved = [moved[0] + d * d, moved[1].max(d)];
        turned = [turned[0] + a * a, turned[1].max(a)];
    }
    let root = |v: [f64; 2]| [(v[0] / measured.times.len() as f64).sqrt(), v[1]];
    Agreement {
        offset_s: clock.offset_s,
        misaligned_rad: clock.misaligned.norm(),
        gyro_bias: clock.bias,
        turn_rms: [turn0, turn1],
        acceleration_rms: [acc0, acc1],
        moved_m: root(moved),
        turned_rad: root(turned),
        longest_hole_s: measured.times.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    /// Ten seconds hand-held: exact readings at 200 Hz, poses at 120 Hz with noise, a gap, a clock offset and
    /// misaligned axes.
    #[test]
    fn recovers_noise_gap_clock_offset_and_misalignment() {
        let pose = |t: f64| {
            let turn = So3::exp(&Vec3::new(0.3 * (2.1 * t).sin(), 0.4 * (1.3 * t).cos(), 0.5 * t));
            Se3::new(turn, Vec3::new((0.9 * t).sin(), 0.6 * (1.7 * t).cos(), 0.2 * (3.0 * t).sin()))
        };
        let fine: Vec<(Stamp, Se3)> =
            (0..11_000).map(|i| (Stamp(i * 1_000_000), pose(i as f64 * 1e-3))).collect();
        let exact = ContinuousTrajectory::through(&fine).unwrap();
        let (gyro_bias, accel_bias) = (Vec3::new(0.01, -0.02, 0.08), Vec3::new(0.05, 0.1, -0.08));
        let readings: Vec<ImuSample> = (0..2190)
            .map(|i| {
                let s = exact.state(i as f64 * 5e-3);
                let force = s.world_from_body.rotation.inverse() * (s.acceleration - GRAVITY);
                ImuSample::new(Stamp(i * 5_000_000), s.rate + gyro_bias, force + accel_bias)
            })
            .collect();
        let mut random = Random::stream(1, 1);
        let mut vector = |s: f64| {
            Vec3::new(random.standard_normal(), random.standard_normal(), random.standard_normal()) * s
        };
        let (offset, askew) = (0.007, Vec3::new(0.02, -0.01, 0.015));
        let poses: Vec<(Stamp, Se3)> = (40..1200)
            .filter(|i| !(500..620).contains(i))
            .map(|i| {
                let t = f64::from(i) / 120.0;
                let p = pose(t);
                let noisy =
                    Se3::new(p.rotation * So3::exp(&(askew + vector(1e-3))), p.translation + vector(5e-4));
                let jump = if i % 97 < 3 { So3::exp(&Vec3::new(0.05, -0.04, 0.0)) } else { So3::identity() };
                (Stamp::from_seconds(t - offset), Se3::new(noisy.rotation * jump, noisy.translation))
            })
            .collect();
        let recorded = Recorded::new(&poses, &readings).unwrap();
        let a = recorded.agreement;
        assert!((a.offset_s - offset).abs() < 1e-3, "{a:?}");
        assert!((a.misaligned_rad - askew.norm()).abs() < 4e-3, "{a:?}");
        assert!((a.gyro_bias - gyro_bias).norm() < 3e-3, "{a:?}");
        assert!((0.9..1.1).contains(&a.longest_hole_s), "{a:?}");
        assert!(a.turn_rms[1] < 5e-4 && a.turn_rms[0] > 2e-3, "{a:?}");
        assert!(a.acceleration_rms[1] < 0.3 && a.acceleration_rms[0] > 10.0, "{a:?}");
        let (mut moved, mut turned) = (0.0f64, 0.0f64);
        for k in 0..900 {
            let t = 0.4 + 0.01 * f64::from(k);
            let found = recorded.motion.pose(Stamp::from_seconds(t) - recorded.epoch);
            moved = moved.max((found.translation - pose(t).translation).norm());
            turned = turned.max((found.rotation.inverse() * pose(t).rotation).angle());
        }
        assert!(moved < 1.5e-2 && turned < 6e-3, "off by {moved} m and {turned} rad");
        assert!(Recorded::new(&poses[..10], &readings).is_err());
    }
}
