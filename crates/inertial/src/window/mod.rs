//! Key frames that were seen and felt, adjusted together: reprojections and inertial links.
//!
//! Per key frame fifteen unknowns: the eye's pose (translation, rotation), velocity, gyro bias, accel bias. Points are
//! eliminated first (Triggs et al. 2000, section 6), the rest by a sparse factor. The world is in metres
//! with gravity as given. The eye is what poses are of, as everywhere in the map; the sensor is one constant transform away,
//! and its Jacobians go through that transform's adjoint.
//!
//! Source: visual-inertial bundle adjustment as in Campos et al., "ORB-SLAM3" (TRO 2021), eq. 3-5.

mod normal;

use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Manifold, Se3, Vec3};
use cairn_solve::sparse::Factor;
use cairn_solve::{CHI2_2, CHI2_3, Observation, Pinhole, Report, Stop};
use nalgebra::SVector;
use normal::{Layout, Normal};
use std::mem::replace;

/// Unknowns of a key frame.
pub const STATE: usize = 15;

/// What of a key frame stays as it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FixedMask {
    /// Nothing.
    Free,
    /// Its pose.
    Pose,
    /// Its place and heading; it may tilt.
    Place,
    /// Its pose and velocity, not its biases.
    Bias,
    /// Its velocity and biases: it has none that are known.
    Motion,
    /// All of it.
    All,
}

impl FixedMask {
    /// Which unknowns stay.
    fn unknowns(self) -> std::ops::Range<usize> {
        match self {
            Self::Free => 0..0,
            Self::Pose => 0..6,
            Self::Place => 0..3,
            Self::Bias => 0..9,
            Self::Motion => 6..STATE,
            Self::All => 0..STATE,
        }
    }
}

/// A key frame with its inertial state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VioFrame {
    /// The eye's pose, metres.
    pub world_from_camera: Se3,
    /// The sensor's velocity in the world, m/s.
    pub velocity: Vec3,
    /// The sensor's biases.
    pub bias: Bias,
    /// What stays.
    pub hold: FixedMask,
}

impl VioFrame {
    /// The sensor's state.
    pub fn nav(&self, imu_from_camera: &Se3) -> NavState {
        let world_from_imu = self.world_from_camera * imu_from_camera.inverse();
        NavState { world_from_imu, velocity: self.velocity, bias: self.bias }
    }

    /// Of a sensor's state.
    pub fn of(state: &NavState, imu_from_camera: &Se3, hold: FixedMask) -> Self {
        let world_from_camera = state.world_from_imu * *imu_from_camera;
        Self { world_from_camera, velocity: state.velocity, bias: state.bias, hold }
    }

    fn moved(&self, d: &SVector<f64, STATE>) -> Self {
        let part = |i: usize| -> Vec3 { d.fixed_rows::<3>(i).into() };
        Self {
            world_from_camera: self.world_from_camera.retract(&d.fixed_rows::<6>(0).into()),
            velocity: self.velocity + part(6),
            bias: Bias { gyro: self.bias.gyro + part(9), accel: self.bias.accel + part(12) },
            hold: self.hold,
        }
    }
}

/// Readings from one key frame of the window to another.
#[derive(Clone, Debug)]
pub struct VioLink {
    /// Index of the earlier.
    pub from: usize,
    /// Index of the later.
    pub to: usize,
    /// Their sum, between the two stamps.
    pub sum: Preintegrated,
}

/// What was known of a key frame's biases before.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiasPrior {
    /// Index of the key frame.
    pub frame: usize,
    /// The biases.
    pub bias: Bias,
    /// Standard deviations of the gyroscope's and the accelerometer's, each axis: rad/s and m/s^2.
    pub sigmas: [f64; 2],
}

impl BiasPrior {
    /// The six whitened residuals and what whitens them.
    fn residual(&self, of: &Bias) -> [(Vec3, f64); 2] {
        let off = [of.gyro - self.bias.gyro, of.accel - self.bias.accel];
        std::array::from_fn(|i| (off[i] / self.sigmas[i], 1.0 / self.sigmas[i]))
    }
}

/// The problem and, after [`VioWindow::solve`], its solution.
#[derive(Clone, Debug)]
pub struct VioWindow {
    /// The camera of all key frames.
    pub camera: Pinhole,
    /// Where the eye sits on the sensor.
    pub imu_from_camera: Se3,
    /// Gravity in the world.
    pub gravity: Gravity,
    /// Key frames.
    pub frames: Vec<VioFrame>,
    /// Points in the world, metres.
    pub points: Vec<Vec3>,
    /// Observations, grouped by point: all of a point stand together. A weight of 0 leaves one out.
    pub observations: Vec<Observation>,
    /// Links; none where readings are missing.
    pub links: Vec<VioLink>,
    /// What was known of biases before.
    pub bias_priors: Vec<BiasPrior>,
}

/// How to solve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VioConfig {
    /// Steps at most, rejected ones too.
    pub iterations: usize,
    /// Whether Huber's loss is used for observations.
    pub robust: bool,
    /// Stop when a step lowers the cost by less than this part of it.
    pub tolerance: f64,
}

impl Default for VioConfig {
    fn default() -> Self {
        Self { iterations: 10, robust: true, tolerance: 1e-5 }
    }
}

impl VioWindow {
    /// Lowers the cost; asks `stop` before each step. Links whose bias has moved far are summed anew.
    pub fn solve(&mut self, config: &VioConfig, mut stop: impl FnMut() -> bool) -> Report {
        let mut report =
            Report { iterations: 0, cost_before: 0.0, cost_after: 0.0, inliers: 0, stop: Stop::Empty };
        if self.frames.iter().all(|f| f.hold == FixedMask::All) && self.points.is_empty() {
            return report;
        }
        self.follow();
        let layout = Layout::of(self);
        let mut factor = Factor::new(layout.analysis().clone());
        let Some(mut normal) = Normal::of(self, &layout, config.robust) else {
            report.stop = Stop::NoDescent;
            return report;
        };
        report.cost_before = normal.cost;
        report.stop = Stop::Iterations;
        let (mut lambda, mut growth) = (1e-6, 2.0);
        while report.iterations < config.iterations {
            if stop() {
                report.stop = Stop::Interrupted;
                break;
            }
            report.iterations += 1;
            let lower = normal.step(self, &layout, &mut factor, lambda).and_then(|(frames, points)| {
                let before = (replace(&mut self.frames, frames), replace(&mut self.points, points));
                let cost = self.cost(config.robust);
                if cost < normal.cost {
                    return Some(cost);
                }
                (self.frames, self.points) = before;
                None
            });
            match lower {
                Some(cost) => {
                    let gain = (normal.cost - cost) / normal.cost;
                    self.follow();
                    (lambda, growth) = ((lambda / 5.0).max(1e-10), 2.0);
                    if gain < config.tolerance {
                        normal.cost = cost;
                        report.stop = Stop::Converged;
                        break;
                    }
                    match Normal::of(self, &layout, config.robust) {
                        Some(n) => normal = n,
                        None => break,
                    }
                }
                None => {
                    lambda *= growth * 5.0;
                    growth *= 2.0;
                    if lambda > 1e6 {
                        report.stop = Stop::NoDescent;
                        break;
                    }
                }
            }
        }
        report.cost_after = normal.cost;
        let fits = |o: &&Observation| o.weight > 0.0 && self.chi2(o) <= bound(o);
        report.inliers = self.observations.iter().filter(fits).count();
        report
    }

    /// Squared whitened residual of an observation; infinite behind the eye.
    pub fn chi2(&self, o: &Observation) -> f64 {
        let (frame, point) = (&self.frames[o.pose as usize], &self.points[o.point as usize]);
        match self.camera.reproject(&frame.world_from_camera, point, &o.pixel) {
            Some(l) => l.residual.iter().map(|r| r * r).sum::<f64>() * o.weight,
            None => f64::INFINITY,
        }
    }

    /// The squared whitened residual of each link, fifteen degrees of freedom: over 30.6 one in a hundred fits by chance.
    pub fn link_chi2(&self) -> Vec<f64> {
        self.links.iter().map(|l| self.whitened(l).map_or(f64::INFINITY, |r| r.norm_squared())).collect()
    }

    fn follow(&mut self) {
        for link in &mut self.links {
            link.sum.follow(&self.frames[link.from].bias);
        }
    }

    fn whitened(&self, link: &VioLink) -> Option<SVector<f64, STATE>> {
        let nav = |i: usize| self.frames[i].nav(&self.imu_from_camera);
        Some(link.sum.whitening()? * link.sum.residual(&nav(link.from), &nav(link.to), &self.gravity))
    }

    fn cost(&self, robust: bool) -> f64 {
        let mut cost = 0.0;
        for link in &self.links {
            cost += self.whitened(link).map_or(f64::INFINITY, |r| 0.5 * r.norm_squared());
        }
        for prior in &self.bias_priors {
            let parts = prior.residual(&self.frames[prior.frame].bias);
            cost += parts.iter().map(|(r, _)| 0.5 * r.norm_squared()).sum::<f64>();
        }
        for o in self.observations.iter().filter(|o| o.weight > 0.0) {
            let chi2 = self.chi2(o);
            cost += 0.5 * if robust { cairn_solve::huber(chi2, bound(o)).0 } else { chi2 };
        }
        if cost.is_finite() { cost } else { f64::INFINITY }
    }
}

/// The 95 % bound of an observation's chi-square.
fn bound(o: &Observation) -> f64 {
    if o.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 }
}
