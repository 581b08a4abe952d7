//! Pose of a depth camera from its depth and a field alone: points against distance and gradient, without ray
//! casting.
//!
//! Bylow et al., "Real-time camera tracking and 3D reconstruction using signed distance functions" (RSS 2013),
//! section IV, with distances divided by the gradient's length (ours are along the rays that saw the surface) and
//! robust weights. Directions that the surface does not constrain are left to the prior: Zhang, Kaess and Singh, "On
//! degeneracy of optimization-based state estimation problems" (ICRA 2016), section V.

use crate::frame::DepthFrame;
use crate::sample::Sampler;
use crate::tsdf::TsdfVolume;
use crate::{DenseError, DepthNoise};
use cairn_geometry::{Manifold, Se3, Vec3};
use nalgebra::{Matrix6, SymmetricEigen, Vector6};

/// Configuration of dense tracking.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackConfig {
    /// Approximate number of points on the coarsest and on the finest level.
    pub points: [usize; 2],
    /// Maximum number of iterations on each of the three levels.
    pub iterations: [usize; 3],
    /// Distances beyond this many metres are down-weighted (Huber), in addition to the noise.
    pub huber_m: f64,
    /// Depth noise model.
    pub noise: DepthNoise,
    /// A direction is constrained when its standard deviation is below this, in metres (rotations: displacement at 1
    /// m).
    pub fixed_m: f64,
    /// With a smaller share of points near the surface than this, the frame is not tracked.
    pub least_share: f64,
}

impl Default for TrackConfig {
    fn default() -> Self {
        Self {
            points: [1000, 6000],
            iterations: [10, 8, 6],
            huber_m: 0.01,
            noise: DepthNoise::default(),
            fixed_m: 0.005,
            least_share: 0.3,
        }
    }
}

/// Result of tracking.
#[derive(Clone, Debug, PartialEq)]
pub struct DenseTracked {
    /// The pose.
    pub volume_from_camera: Se3,
    /// Covariance of its right perturbation (translation, rotation), from the Hessian at the solution; directions
    /// that the surface does not constrain have a large one.
    pub covariance: Matrix6<f64>,
    /// Number of points near the surface, and of all points tried.
    pub points: [usize; 2],
    /// Root mean square distance of those points to the surface, in metres.
    pub rms_m: f64,
    /// Directions (translation, rotation; unit length) that the surface does not constrain: along these the pose is
    /// the guess's.
    pub free: Vec<Vector6<f64>>,
    /// Whether the last step was small and enough points lay near the surface.
    pub converged: bool,
}

/// A step smaller than this ends a level: metres and radians.
const SMALL: f64 = 2e-5;

/// Finds the pose of a frame near a guess. A result that did not converge is a value with its numbers, not an error.
///
/// # Errors
/// A guess that is not finite.
pub fn track(
    volume: &TsdfVolume,
    frame: &DepthFrame,
    guess: &Se3,
    config: &TrackConfig,
) -> Result<DenseTracked, DenseError> {
    if !guess.is_finite() {
        return Err(DenseError::Pose("a number is not finite".into()));
    }
    let sampler = Sampler::new(volume);
    let mut pose = *guess;
    let mut small = false;
    for (level, &iterations) in config.iterations.iter().enumerate() {
        let points = points(frame, config, level);
        small = false;
        for _ in 0..iterations {
            let normal = Normal::build(&sampler, volume, &points, &pose, config);
            let (step, _) = normal.solve(config);
            pose = pose.retract(&step);
            small = step.norm() < SMALL;
            if small || !pose.is_finite() {
                break;
            }
        }
        if !pose.is_finite() {
            pose = *guess;
            break;
        }
    }
    let points = points(frame, config, config.iterations.len() - 1);
    let normal = Normal::build(&sampler, volume, &points, &pose, config);
    let (step, free) = normal.solve(config);
    let enough = normal.used as f64 >= config.least_share * points.len() as f64 && normal.used >= 50;
    Ok(DenseTracked {
        volume_from_camera: pose,
        covariance: normal.covariance(),
        points: [normal.used, points.len()],
        rms_m: normal.rms_m(),
        free,
        converged: enough && (small || step.norm() < 20.0 * SMALL),
    })
}

/// Points of a frame on a regular pixel grid, with the inverse of their standard deviation.
fn points(frame: &DepthFrame, config: &TrackConfig, level: usize) -> Vec<(Vec3, f64)> {
    let last = config.iterations.len() - 1;
    let part = level as f64 / last.max(1) as f64;
    let wanted = config.points[0] as f64 * (config.points[1] as f64 / config.points[0] as f64).powf(part);
    let stride = ((frame.valid() as f64 / wanted.max(1.0)).sqrt() as usize).max(1);
    let c = frame.camera();
    let mut out = Vec::with_capacity(wanted as usize + 64);
    for y in (stride / 2..c.height).step_by(stride) {
        for x in (stride / 2..c.width).step_by(stride) {
            if let Some(z) = frame.depth_m(x, y).map(f64::from) {
                let ray = Vec3::new((x as f64 - c.cx) / c.fx, (y as f64 - c.cy) / c.fy, 1.0);
                out.push((ray * z, 1.0 / config.noise.sigma_m(z)));
            }
        }
    }
    out
}

/// Normal equations of all points, for a right perturbation of the pose.
#[derive(Default)]
pub(crate) struct Normal {
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    used: usize,
    /// Sum of squared distances in square metres.
    square: f64,
    /// Sum of squared whitened distances with their weights.
    cost: f64,
}

impl Normal {
    pub(crate) fn build(
        sampler: &Sampler,
        volume: &TsdfVolume,
        points: &[(Vec3, f64)],
        pose: &Se3,
        config: &TrackConfig,
    ) -> Self {
        let (r, t) = (pose.rotation.matrix(), pose.translation);
        let voxel = volume.config().voxel_m;
        let floor = config.noise.floor_m;
        let mut out = Self::default();
        for (p, by_sigma) in points {
            let at = r * p + t;
            let Some(sample) = sampler.at([at.x as f32, at.y as f32, at.z as f32]) else { continue };
            let g = Vec3::from(sample.gradient.map(f64::from));
            let length = g.norm();
            // Where the field is truncated it has no gradient.
            if length < 32.0 {
                continue;
            }
            let distance = f64::from(sample.steps) / length * voxel;
            let n = r.transpose() * (g / length);
            let huber = config.huber_m + floor;
            let robust = if distance.abs() <= huber { 1.0 } else { huber / distance.abs() };
            let weight = robust * by_sigma * by_sigma;
            out.add(p, &n, distance, weight);
        }
        out
    }

    /// Adds a point of the moved frame, with the surface's normal in that frame and its distance along it in metres.
    #[inline(always)]
    pub(crate) fn add(&mut self, p: &Vec3, n: &Vec3, distance: f64, weight: f64) {
        let turn = p.cross(n);
        let j = Vector6::new(n.x, n.y, n.z, turn.x, turn.y, turn.z);
        self.hessian += j * j.transpose() * weight;
        self.gradient += j * (distance * weight);
        self.used += 1;
        self.square += distance * distance;
        self.cost += weight * distance * distance;
    }

    /// Leaves only rotations about `up` (unit, in the moved frame) and translations: the others are made too stiff to
    /// move.
    pub(crate) fn keep_upright(&mut self, up: &Vec3) {
        let stiff = 1e6 * self.hessian.trace().max(1.0);
        let across = (nalgebra::Matrix3::identity() - up * up.transpose()) * stiff;
        let mut block = self.hessian.fixed_view_mut::<3, 3>(3, 3);
        block += across;
    }

    /// Root mean square distance of the points used, in metres.
    pub(crate) fn rms_m(&self) -> f64 {
        (self.square / self.used.max(1) as f64).sqrt()
    }

    /// Variance of a whitened distance; one when the noise is as modelled.
    fn variance(&self) -> f64 {
        (self.cost / (self.used.max(7) - 6) as f64).max(1.0)
    }

    /// The step in the constrained directions, and the unconstrained directions.
    pub(crate) fn solve(&self, config: &TrackConfig) -> (Vector6<f64>, Vec<Vector6<f64>>) {
        let eigen = SymmetricEigen::new(self.hessian);
        let (mut step, mut free) = (Vector6::zeros(), Vec::new());
        // Errors of neighbouring points are correlated: as if only one in sixteen were independent.
        let least = 16.0 * self.variance() / (config.fixed_m * config.fixed_m);
        for i in 0..6 {
            let direction: Vector6<f64> = eigen.eigenvectors.column(i).into();
            let curvature = eigen.eigenvalues[i];
            if curvature.is_finite() && curvature >= least {
                step -= direction * (direction.dot(&self.gradient) / curvature);
            } else {
                free.push(direction);
            }
        }
        (step, free)
    }

    fn covariance(&self) -> Matrix6<f64> {
        let eigen = SymmetricEigen::new(self.hessian);
        let mut out = Matrix6::zeros();
        for i in 0..6 {
            let direction: Vector6<f64> = eigen.eigenvectors.column(i).into();
            let curvature = eigen.eigenvalues[i].max(1e-6);
            out += direction * direction.transpose() * (16.0 * self.variance() / curvature);
        }
        out
    }
}
