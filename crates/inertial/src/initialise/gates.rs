//! The tests of an initialisation, each a value with its number.

use super::estimate::Initial;
use super::input::{InitialiseConfig, Scale, Seen};
use crate::Preintegrated;
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::GRAVITY_M_S2;
use std::fmt;

/// What is tested.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GateKind {
    /// Key frames.
    KeyFrames,
    /// Seconds between the first and the last.
    Seconds,
    /// Key frames in time without a sum of readings that spans just that time.
    Links,
    /// 1 when the clocks of IMU and camera have been compared. The caller adds this test.
    Clocks,
    /// Root mean square of the acceleration around its mean, m/s^2.
    Excitation,
    /// Spread of the camera's positions, in standard deviations of a position.
    Baseline,
    /// 1 when the solver found a minimum.
    Converged,
    /// Weighted squared residual per degree of freedom.
    Residual,
    /// The white noise of the gyroscope, in times its data sheet's. High too where the time offset is wrong.
    GyroNoise,
    /// The white noise of the accelerometer, in times its data sheet's.
    AccelNoise,
    /// How far gravity's norm, when estimated, is from 9.81, beyond twice its standard deviation, m/s^2.
    GravityNorm,
    /// Relative standard deviation of the scale.
    ScaleSigma,
    /// Standard deviation of gravity's direction, rad.
    GravitySigma,
    /// Norm of the gyroscope's bias, rad/s.
    GyroBias,
    /// Norm of the accelerometer's bias, m/s^2.
    AccelBias,
}

impl GateKind {
    /// True for tests without which nothing can be solved.
    pub(super) fn is_structural(self) -> bool {
        matches!(self, Self::KeyFrames | Self::Links)
    }

    fn is_least(self) -> bool {
        matches!(
            self,
            Self::KeyFrames
                | Self::Seconds
                | Self::Clocks
                | Self::Excitation
                | Self::Baseline
                | Self::Converged
        )
    }

    fn words(self) -> (&'static str, &'static str) {
        match self {
            Self::KeyFrames => ("key frames", ""),
            Self::Seconds => ("time", " s"),
            Self::Links => ("key frames without readings", ""),
            Self::Clocks => ("clocks compared", ""),
            Self::Excitation => ("excitation", " m/s^2"),
            Self::Baseline => ("baseline", " sigma"),
            Self::Converged => ("minimum found", ""),
            Self::Residual => ("residual", ""),
            Self::GyroNoise => ("gyro noise", " times the data sheet's"),
            Self::AccelNoise => ("accel noise", " times the data sheet's"),
            Self::GravityNorm => ("gravity's norm is off by", " m/s^2"),
            Self::ScaleSigma => ("scale's sigma", ""),
            Self::GravitySigma => ("gravity's sigma", " rad"),
            Self::GyroBias => ("gyro bias", " rad/s"),
            Self::AccelBias => ("accel bias", " m/s^2"),
        }
    }
}

/// A test with its number.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Gate {
    /// What is tested.
    pub kind: GateKind,
    /// The value found.
    pub value: f64,
    /// The bound: a minimum or a maximum.
    pub bound: f64,
    /// Whether it is passed.
    pub passed: bool,
}

impl Gate {
    /// A number against its bound.
    pub fn new(kind: GateKind, value: f64, bound: f64) -> Self {
        let passed = if kind.is_least() { value >= bound } else { value <= bound };
        Self { kind, value, bound, passed }
    }
}

impl fmt::Display for Gate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit) = self.kind.words();
        let side = if self.kind.is_least() { "at least" } else { "at most" };
        let verdict = if self.passed { "good" } else { "failed" };
        write!(f, "{name} {:.4}{unit} ({side} {:.4}{unit}: {verdict})", self.value, self.bound)
    }
}

/// Tests before the solve.
pub fn before(
    seen: &Seen,
    links: &[Preintegrated],
    imu_from_camera: &Se3,
    scale: Scale,
    s: &InitialiseConfig,
) -> Vec<Gate> {
    let poses = seen.poses;
    let seconds = match (poses.first(), poses.last()) {
        (Some(a), Some(b)) => b.stamp - a.stamp,
        _ => 0.0,
    };
    let mut unlinked = poses.len().saturating_sub(1).abs_diff(links.len());
    for (pair, link) in poses.windows(2).zip(links) {
        let fits = |(from, to)| from == pair[0].stamp && to == pair[1].stamp && from < to;
        unlinked += !link.span().is_some_and(fits) as usize;
    }
    unlinked += poses.iter().filter(|p| !p.world_from_camera.is_finite()).count();
    // With fewer than three, no equation has more rows than unknowns.
    let mut gates = vec![
        Gate::new(GateKind::KeyFrames, poses.len() as f64, s.least_key_frames.max(3) as f64),
        Gate::new(GateKind::Links, unlinked as f64, 0.0),
        Gate::new(GateKind::Seconds, seconds, s.least_seconds),
    ];
    if scale == Scale::Free && gates.iter().all(|g| g.passed || !g.kind.is_structural()) {
        gates.push(Gate::new(
            GateKind::Excitation,
            excitation(seen, links, imu_from_camera),
            s.least_excitation,
        ));
        gates.push(Gate::new(GateKind::Baseline, baseline(seen), s.least_baseline));
    }
    gates
}

pub fn converged(found: bool) -> Gate {
    Gate::new(GateKind::Converged, found as u8 as f64, 1.0)
}

/// Tests of a solution.
pub fn after(found: &Initial, scale: Scale, s: &InitialiseConfig) -> Vec<Gate> {
    let [norm, sigma] = found.gravity_norm;
    let off = ((norm - GRAVITY_M_S2).abs() - 2.0 * sigma).max(0.0);
    let mut gates = vec![
        Gate::new(GateKind::Residual, found.residual, s.most_residual),
        Gate::new(GateKind::GyroNoise, found.noise_times[0], s.most_noise_times[0]),
        Gate::new(GateKind::AccelNoise, found.noise_times[1], s.most_noise_times[1]),
        Gate::new(GateKind::GravityNorm, off, s.most_gravity_off),
        Gate::new(GateKind::GravitySigma, found.gravity_sigma, s.most_gravity_sigma),
        Gate::new(GateKind::GyroBias, found.bias.gyro.norm(), s.most_gyro_bias),
        Gate::new(GateKind::AccelBias, found.bias.accel.norm(), s.most_accel_bias),
    ];
    if scale == Scale::Free {
        gates.push(Gate::new(GateKind::ScaleSigma, found.scale_sigma, s.most_scale_sigma));
    }
    gates
}

/// Root mean square of the mean acceleration of each link around the mean of all, in the frame of the map.
fn excitation(seen: &Seen, links: &[Preintegrated], imu_from_camera: &Se3) -> f64 {
    let camera_from_imu = imu_from_camera.rotation.inverse();
    spread(seen.poses.iter().zip(links).map(|(pose, link)| {
        let (_, velocity, _) = link.gained(link.bias());
        pose.world_from_camera.rotation * (camera_from_imu * velocity) / link.seconds()
    }))
}

/// Spread of the camera's positions over the standard deviation of one.
fn baseline(seen: &Seen) -> f64 {
    let spread = spread(seen.poses.iter().map(|p| p.world_from_camera.translation));
    if seen.position_sigma > 0.0 { spread / seen.position_sigma } else { f64::INFINITY }
}

fn spread(values: impl Iterator<Item = Vec3> + Clone) -> f64 {
    let n = values.clone().count().max(1) as f64;
    let mean = values.clone().sum::<Vec3>() / n;
    (values.map(|v| (v - mean).norm_squared()).sum::<f64>() / n).sqrt()
}
