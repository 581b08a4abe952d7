//! The time offset between IMU and camera, and the rotation between them, from the rotations of both.
//!
//! The integrated turn rate of the gyroscope must equal the visual rotation, up to a constant rotation between the two, the
//! bias, and the offset in time (Furgale, Rehder, Siegwart, "Unified temporal and spatial calibration for multi-sensor
//! systems", IROS 2013, section III, on rotations alone and without splines). The sequence is cut into short pieces, each
//! with a heading of its own, so that slow drift on either side does no harm. First a grid over the offset, with the rotation
//! in closed form at each (Kabsch 1976), then Gauss-Newton on offset, bias and rotation.
//!
//! The sign: `t_imu + offset = t_image`.

use cairn_geometry::{Mat3, So3, Vec3};
use cairn_sensor::{ImuSample, Stamp};
use nalgebra::{Cholesky, SMatrix, SVector};

/// Range of the search, and bounds of the result.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OffsetConfig {
    /// Largest offset searched on either side, seconds.
    pub most_s: f64,
    /// Step of the grid, seconds.
    pub grid_s: f64,
    /// Length of a piece, seconds.
    pub piece_s: f64,
    /// Prior of the gyroscope's bias around zero, rad/s.
    pub gyro_bias_sigma: f64,
    /// Prior of the rotation between IMU and camera around the given one, rad.
    pub rotation_sigma: f64,
    /// Minimum number of poses.
    pub least_poses: usize,
    /// Maximum standard deviation of the offset, seconds.
    pub most_sigma_s: f64,
}

impl Default for OffsetConfig {
    fn default() -> Self {
        Self {
            most_s: 0.1,
            grid_s: 0.005,
            piece_s: 1.0,
            gyro_bias_sigma: 0.1,
            rotation_sigma: 0.1,
            least_poses: 40,
            most_sigma_s: 0.001,
        }
    }
}

/// A step between visual and integrated rotation of more than so many times the median is not noise.
const JUMP: f64 = 4.0;

/// The estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimeOffset {
    /// Seconds to add to the samples' stamps to get the poses' clock, beyond what was added already.
    pub offset_s: f64,
    /// Its standard deviation.
    pub sigma_s: f64,
    /// The gyroscope's bias, rad/s.
    pub gyro_bias: Vec3,
    /// The rotation from the camera's axes to the IMU's.
    pub imu_from_camera: So3,
    /// The angle between that and the given one, rad.
    pub misaligned: f64,
    /// The standard deviation of that rotation about its least certain axis, rad.
    pub rotation_sigma: f64,
    /// Root mean square residual, rad.
    pub residual: f64,
    /// Poses used.
    pub poses: usize,
}

/// Why there is no offset, with the number that shows it.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum OffsetUnknown {
    /// Too few poses with readings around them.
    #[error("{found} poses with readings around them, {need} are needed")]
    TooFew {
        /// Poses.
        found: usize,
        /// Bound.
        need: usize,
    },
    /// The rotations do not determine it.
    #[error("the offset is known to {sigma_s:.5} s only, {most_s:.5} s are asked for: turn more")]
    TooLittleTurn {
        /// Standard deviation.
        sigma_s: f64,
        /// Bound.
        most_s: f64,
    },
    /// The best offset lies at the end of the search range.
    #[error("the best offset, {offset_s:.3} s, lies at the end of what is looked at")]
    AtTheEnd {
        /// Seconds.
        offset_s: f64,
    },
}

/// Unknowns: offset, bias (3), rotation (3).
const N: usize = 7;

/// Finds the offset from poses at the rate of the images (`world_from_camera`, in time) and the readings around them.
///
/// # Errors
/// When the poses are too few or turn too little to determine it.
pub fn time_offset(
    poses: &[(Stamp, So3)],
    samples: &[ImuSample],
    imu_from_camera: &So3,
    config: &OffsetConfig,
) -> Result<TimeOffset, OffsetUnknown> {
    let margin = config.most_s + 0.02;
    let within = |t: &Stamp| match (samples.first(), samples.last()) {
        (Some(a), Some(b)) => *t - a.stamp > margin && b.stamp - *t > margin,
        _ => false,
    };
    let poses: Vec<(Stamp, So3)> = poses.iter().filter(|(t, _)| within(t)).copied().collect();
    if poses.len() < config.least_poses.max(3) {
        return Err(OffsetUnknown::TooFew { found: poses.len(), need: config.least_poses.max(3) });
    }
    let (offset, rotation) = coarse(&poses, samples, imu_from_camera, config);
    let mut state = State { offset, bias: Vec3::zeros(), rotation };
    let mut last = None;
    for _ in 0..8 {
        let gyro = Gyro::integrate(samples, &state.bias);
        let Some((step, covariance, residual)) = refine(&poses, &gyro, &state, imu_from_camera, config)
        else {
            break;
        };
        state.offset += step[0].clamp(-0.01, 0.01);
        state.bias += Vec3::from(step.fixed_rows::<3>(1));
        state.rotation = So3::exp(&step.fixed_rows::<3>(4).into()) * state.rotation;
        state.offset = state.offset.clamp(-config.most_s, config.most_s);
        last = Some((covariance, residual));
        if step[0].abs() < 1e-6 {
            break;
        }
    }
    let Some((covariance, residual)) = last else {
        return Err(OffsetUnknown::TooLittleTurn { sigma_s: f64::INFINITY, most_s: config.most_sigma_s });
    };
    let sigma_s = covariance[(0, 0)].sqrt();
    if sigma_s.is_nan() || sigma_s > config.most_sigma_s {
        return Err(OffsetUnknown::TooLittleTurn { sigma_s, most_s: config.most_sigma_s });
    }
    if state.offset.abs() >= config.most_s {
        return Err(OffsetUnknown::AtTheEnd { offset_s: state.offset });
    }
    let turns: Mat3 = covariance.fixed_view::<3, 3>(4, 4).into();
    Ok(TimeOffset {
        offset_s: state.offset,
        sigma_s,
        gyro_bias: state.bias,
        imu_from_camera: state.rotation,
        misaligned: (imu_from_camera.inverse() * state.rotation).angle(),
        rotation_sigma: turns.symmetric_eigenvalues().max().max(0.0).sqrt(),
        residual,
        poses: poses.len(),
    })
}

struct State {
    offset: f64,
    bias: Vec3,
    rotation: So3,
}

/// The gyroscope's readings integrated from the first sample on.
struct Gyro<'a> {
    samples: &'a [ImuSample],
    bias: Vec3,
    /// Orientation at each sample in the frame of the first.
    turned: Vec<So3>,
    /// The integral of its matrix over time: how the orientation follows the bias.
    by_bias: Vec<Mat3>,
}

/// At one instant.
struct Instant {
    turned: So3,
    by_bias: Mat3,
    rate: Vec3,
}

impl<'a> Gyro<'a> {
    fn integrate(samples: &'a [ImuSample], bias: &Vec3) -> Self {
        let (mut turned, mut by_bias) = (vec![So3::identity()], vec![Mat3::zeros()]);
        let (mut r, mut d) = (So3::identity(), Mat3::zeros());
        for pair in samples.windows(2) {
            let dt = pair[1].stamp - pair[0].stamp;
            let before = r.matrix();
            r = r * So3::exp(&(((pair[0].gyro + pair[1].gyro) * 0.5 - bias) * dt));
            d += (before + r.matrix()) * (0.5 * dt);
            turned.push(r);
            by_bias.push(d);
        }
        Self { samples, bias: *bias, turned, by_bias }
    }

    fn at(&self, stamp: Stamp) -> Instant {
        let last = self.samples.len() - 1;
        let i = self.samples.partition_point(|s| s.stamp <= stamp).clamp(1, last.max(1)).min(last);
        let (a, b) = (&self.samples[i.saturating_sub(1)], &self.samples[i]);
        let dt = stamp - a.stamp;
        let part = dt / (b.stamp - a.stamp).max(1e-9);
        let rate = a.gyro + (b.gyro - a.gyro) * part - self.bias;
        let from = i.saturating_sub(1);
        let mean = (a.gyro - self.bias + rate) * 0.5;
        let turned = self.turned[from] * So3::exp(&(mean * dt));
        Instant { turned, by_bias: self.by_bias[from] + self.turned[from].matrix() * dt, rate }
    }
}

/// The best offset of a grid, and the rotation there: the given one, unless the rotations clearly ask for another.
fn coarse(poses: &[(Stamp, So3)], samples: &[ImuSample], given: &So3, s: &OffsetConfig) -> (f64, So3) {
    let gyro = Gyro::integrate(samples, &Vec3::zeros());
    let seen: Vec<Vec3> = poses.windows(2).map(|w| (w[0].1.inverse() * w[1].1).log()).collect();
    let steps = (s.most_s / s.grid_s).floor() as i64;
    let mut best = (f64::INFINITY, 0.0, *given);
    for step in -steps..=steps {
        let offset = step as f64 * s.grid_s;
        let at: Vec<So3> = poses.iter().map(|(t, _)| gyro.at(t.plus_seconds(-offset)).turned).collect();
        let integrated: Vec<Vec3> = at.windows(2).map(|w| (w[0].inverse() * w[1]).log()).collect();
        let n = seen.len() as f64;
        let (seen_mean, felt_mean) = (seen.iter().sum::<Vec3>() / n, integrated.iter().sum::<Vec3>() / n);
        let mut h = Mat3::zeros();
        for (e, i) in seen.iter().zip(&integrated) {
            h += (i - felt_mean) * (e - seen_mean).transpose();
        }
        let singular = h.singular_values();
        // Rotations about one axis alone do not determine it.
        let own = if singular[1] > 0.02 * singular[0] { So3::from_matrix(&h) } else { *given };
        let rotation = if (given.inverse() * own).angle() < 3.0 * s.rotation_sigma { *given } else { own };
        let left = |e: &Vec3, i: &Vec3| ((i - felt_mean) - rotation * (e - seen_mean)).norm_squared();
        let cost = seen.iter().zip(&integrated).map(|(e, i)| left(e, i)).sum::<f64>();
        if cost < best.0 {
            best = (cost, offset, rotation);
        }
    }
    (best.1, best.2)
}

/// One step of Gauss-Newton, the covariance, and the root mean square residual before the step.
fn refine(
    poses: &[(Stamp, So3)],
    gyro: &Gyro,
    state: &State,
    given: &So3,
    s: &OffsetConfig,
) -> Option<(SVector<f64, N>, SMatrix<f64, N, N>, f64)> {
    let mut rows: Vec<(SMatrix<f64, 3, N>, Vec3)> = Vec::with_capacity(poses.len());
    let jumps = jumps(poses, gyro, state);
    let mut pieces = 0;
    let mut begin = 0;
    while begin < poses.len() {
        let goes_on = |k: &usize| poses[*k].0 - poses[begin].0 < s.piece_s && !jumps[*k];
        let end = begin + 1 + (begin + 1..poses.len()).take_while(goes_on).count();
        if end - begin >= 4 {
            piece(&poses[begin..end], gyro, state, &mut rows);
            pieces += 1;
        }
        begin = end;
    }
    let mut norms: Vec<f64> = rows.iter().map(|(_, r)| r.norm()).collect();
    norms.sort_by(f64::total_cmp);
    // Residuals over three times the median weigh less (Huber).
    let bound = (3.0 * norms.get(norms.len() / 2)?).max(1e-6);
    let mut h = SMatrix::<f64, N, N>::zeros();
    let mut b = SVector::<f64, N>::zeros();
    let (mut sum, mut weights) = (0.0, 0.0);
    for (a, r) in &rows {
        let w = (bound / r.norm().max(1e-12)).min(1.0);
        h += a.transpose() * a * w;
        b += a.transpose() * r * w;
        sum += w * r.norm_squared();
        weights += w;
    }
    let freedom = (3.0 * (weights - pieces as f64) - N as f64).max(1.0);
    let variance = (sum / freedom).max(1e-12);
    let (mut hp, mut bp) = (h / variance, b / variance);
    let turn = (state.rotation * given.inverse()).log();
    let turn = if turn.norm() < 3.0 * s.rotation_sigma { turn } else { Vec3::zeros() };
    for k in 0..3 {
        hp[(1 + k, 1 + k)] += s.gyro_bias_sigma.powi(-2);
        bp[1 + k] += state.bias[k] * s.gyro_bias_sigma.powi(-2);
        hp[(4 + k, 4 + k)] += s.rotation_sigma.powi(-2);
        bp[4 + k] += turn[k] * s.rotation_sigma.powi(-2);
    }
    let covariance = Cholesky::new(hp)?.inverse();
    Some((-(covariance * bp), covariance, (sum / weights.max(1.0)).sqrt()))
}

/// Outliers of the step between visual and integrated rotation: there the map itself has moved.
fn jumps(poses: &[(Stamp, So3)], gyro: &Gyro, state: &State) -> Vec<bool> {
    let camera_from_imu = state.rotation.inverse();
    let apart = |(stamp, world_from_camera): &(Stamp, So3)| {
        *world_from_camera * camera_from_imu * gyro.at(stamp.plus_seconds(-state.offset)).turned.inverse()
    };
    let steps: Vec<f64> = poses.windows(2).map(|w| (apart(&w[0]).inverse() * apart(&w[1])).angle()).collect();
    let mut sorted = steps.clone();
    sorted.sort_by(f64::total_cmp);
    let bound = JUMP * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    std::iter::once(false).chain(steps.iter().map(|step| *step > bound)).collect()
}

/// The rows of a piece, its heading taken out by its mean.
fn piece(poses: &[(Stamp, So3)], gyro: &Gyro, state: &State, rows: &mut Vec<(SMatrix<f64, 3, N>, Vec3)>) {
    let camera_from_imu = state.rotation.inverse();
    let first = rows.len();
    let mut start: Option<So3> = None;
    for (stamp, world_from_camera) in poses {
        let i = gyro.at(stamp.plus_seconds(-state.offset));
        let apart = *world_from_camera * camera_from_imu * i.turned.inverse();
        let start = *start.get_or_insert(apart);
        let turned = i.turned.matrix();
        let mut row = SMatrix::<f64, 3, N>::zeros();
        row.set_column(0, &(turned * i.rate));
        row.fixed_view_mut::<3, 3>(0, 1).copy_from(&i.by_bias);
        row.fixed_view_mut::<3, 3>(0, 4).copy_from(&-turned);
        rows.push((row, (start.inverse() * apart).log()));
    }
    let n = poses.len() as f64;
    let mean = rows[first..].iter().fold((SMatrix::<f64, 3, N>::zeros(), Vec3::zeros()), |sum, row| {
        (sum.0 + row.0 / n, sum.1 + row.1 / n)
    });
    for row in &mut rows[first..] {
        row.0 -= mean.0;
        row.1 -= mean.1;
    }
}
