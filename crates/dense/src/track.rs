//! Pose of a depth camera from its depth and a field alone: points against distance and gradient, without ray
//! casting.
//!
//! Bylow et al., "Real-time camera tracking and 3D reconstruction using signed distance functions" (RSS 2013),
//! section IV, with distances divided by the gradient's length (ours are along the rays that saw the surface) and
//! robust weights. Directions that the surface does not constrain are left to the prior: Zhang, Kaess and Singh, "On
//! degeneracy of optimization-based state estimation problems" (ICRA 2016), section V. Noise in the normals makes directions
//! look constrained that are not (along a wall, 6,000 normals off by 3 degrees give 4 mm): the squares in the Hessian add their noise
//! up. So constraints are judged by products of two normals whose noise is independent, the field's and that of the image
//! itself (instrumental variables: Söderström and Stoica, "Instrumental variable methods for system identification", 1983).

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
    /// Covariance of its right perturbation (translation, rotation) by the surface alone, from the Hessian at the solution; directions
    /// that the surface does not constrain have a large one.
    pub covariance: Matrix6<f64>,
    /// Number of points near the surface, and of all points tried.
    pub points: [usize; 2],
    /// Root mean square distance of those points to the surface, in metres.
    pub rms_m: f64,
    /// Directions (translation, rotation; unit length) that the surface does not constrain: along these the pose is
    /// the guess's, or nearly so ([`track_from`]).
    pub free: Vec<Vector6<f64>>,
    /// Whether the last step was small, by itself or beside the uncertainty, and enough points lay near the surface.
    pub converged: bool,
}

/// A step smaller than this ends a level: metres and radians.
const SMALL: f64 = 2e-5;

/// With a prior, a level ends at a step of so many standard deviations of the pose.
const STILL: f64 = 0.1;
/// A last step of so many standard deviations of the pose counts as none.
const SMALL_SHARE: f64 = 0.5;
/// Errors of neighbouring points are correlated: as if only one in so many were independent.
const CORRELATED: f64 = 16.0;
/// A direction is mostly noise when less than this share of its curvature is confirmed by the normals of the image.
const MOSTLY_NOISE: f64 = 0.25;
/// Information on a direction of which the surface says nothing: a standard deviation of 10 m or rad.
const LEAST_INFORMATION: f64 = 0.01;

/// Finds the pose of a frame near a guess, to which directions are left that the surface does not constrain. A result that did not
/// converge is a value with its numbers, not an error.
///
/// # Errors
/// A guess that is not finite.
pub fn track(
    volume: &TsdfVolume,
    frame: &DepthFrame,
    guess: &Se3,
    config: &TrackConfig,
) -> Result<DenseTracked, DenseError> {
    find(volume, frame, guess, config, 0.0, |normal, _| {
        let (step, _) = normal.solve(config);
        let information = normal.covariance().try_inverse().unwrap_or_default();
        (step, information)
    })
}

/// The same where the guess is known with a covariance, of its right perturbation: each direction is that of the surface or of the
/// guess, as they are certain.
///
/// # Errors
/// A guess or a covariance that is not finite or not positive.
pub fn track_from(
    volume: &TsdfVolume,
    frame: &DepthFrame,
    guess: &Se3,
    covariance: &Matrix6<f64>,
    config: &TrackConfig,
) -> Result<DenseTracked, DenseError> {
    let prior = covariance.cholesky().map(|c| c.inverse()).filter(|i| i.iter().all(|v| v.is_finite()));
    let prior = prior.ok_or_else(|| DenseError::Pose("its covariance is not positive".into()))?;
    find(volume, frame, guess, config, STILL, |normal, pose| normal.solve_with(&prior, &guess.local(pose)))
}

/// Length of a step in standard deviations of the pose.
fn in_deviations(step: &Vector6<f64>, information: &Matrix6<f64>) -> f64 {
    step.dot(&(information * step)).sqrt()
}

/// Steps from the guess, level by level; `step` gives the next one with the information behind it. One of less than `still` standard
/// deviations ends a level.
fn find(
    volume: &TsdfVolume,
    frame: &DepthFrame,
    guess: &Se3,
    config: &TrackConfig,
    still: f64,
    step: impl Fn(&Normal, &Se3) -> (Vector6<f64>, Matrix6<f64>),
) -> Result<DenseTracked, DenseError> {
    if !guess.is_finite() {
        return Err(DenseError::Pose("a number is not finite".into()));
    }
    let sampler = Sampler::new(volume);
    let mut pose = *guess;
    let mut small = false;
    let mut last = (Vec::new(), Vec::new());
    for (level, &iterations) in config.iterations.iter().enumerate() {
        let points = points(frame, config, level);
        last = (normals(frame, &points), points);
        small = false;
        let mut crossed = None;
        for _ in 0..iterations {
            // What is noise hardly changes within a level: it is looked at once.
            let seen = if crossed.is_none() { &last.0[..] } else { &[] };
            let mut normal = Normal::build(&sampler, volume, &last.1, seen, &pose, config);
            (normal.own, normal.crossed) = *crossed.get_or_insert((normal.own, normal.crossed));
            let (step, information) = step(&normal, &pose);
            pose = pose.retract(&step);
            small = step.norm() < SMALL || in_deviations(&step, &information) < still;
            if small || !pose.is_finite() {
                break;
            }
        }
        if !pose.is_finite() {
            pose = *guess;
            break;
        }
    }
    let (normals, points) = last;
    let normal = Normal::build(&sampler, volume, &points, &normals, &pose, config);
    let (step, information) = step(&normal, &pose);
    let free = normal.free(config);
    let enough = normal.used as f64 >= config.least_share * points.len() as f64 && normal.used >= 50;
    Ok(DenseTracked {
        volume_from_camera: pose,
        covariance: normal.covariance(),
        points: [normal.used, points.len()],
        rms_m: normal.rms_m(),
        free,
        converged: enough
            && (small || step.norm() < 20.0 * SMALL || in_deviations(&step, &information) < SMALL_SHARE),
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

/// Normals of the image itself at points of its pixel grid, towards the camera, from pixels an eightieth of its width to the sides;
/// `None` at edges and where depth is missing.
fn normals(frame: &DepthFrame, points: &[(Vec3, f64)]) -> Vec<Option<Vec3>> {
    let c = frame.camera();
    let apart = (c.width / 80).max(2);
    let normal = |p: &Vec3| {
        let (x, y) = (p.x / p.z * c.fx + c.cx, p.y / p.z * c.fy + c.cy);
        let (x, y) = (x.round() as usize, y.round() as usize);
        let at = |x: usize, y: usize| {
            let z = f64::from(frame.depth_m(x, y)?);
            let near = (z - p.z).abs() < 0.1 * p.z;
            near.then(|| Vec3::new((x as f64 - c.cx) / c.fx, (y as f64 - c.cy) / c.fy, 1.0) * z)
        };
        let across = at(x + apart, y)? - at(x.checked_sub(apart)?, y)?;
        let down = at(x, y + apart)? - at(x, y.checked_sub(apart)?)?;
        let n = across.cross(&down).try_normalize(1e-12)?;
        Some(if n.dot(p) > 0.0 { -n } else { n })
    };
    points.iter().map(|(p, _)| normal(p)).collect()
}

/// Normal equations of all points, for a right perturbation of the pose.
#[derive(Default)]
pub(crate) struct Normal {
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    /// The Hessian of the points whose normal the image gives too, and the same as products of both normals.
    own: Matrix6<f64>,
    crossed: Matrix6<f64>,
    used: usize,
    /// Sum of squared distances in square metres.
    square: f64,
    /// Sum of squared whitened distances with their weights.
    cost: f64,
}

impl Normal {
    /// `normals` are those of the points by their own image, towards the camera; or none at all.
    pub(crate) fn build(
        sampler: &Sampler,
        volume: &TsdfVolume,
        points: &[(Vec3, f64)],
        normals: &[Option<Vec3>],
        pose: &Se3,
        config: &TrackConfig,
    ) -> Self {
        let (r, t) = (pose.rotation.matrix(), pose.translation);
        let voxel = volume.config().voxel_m;
        let floor = config.noise.floor_m;
        let mut out = Self::default();
        for (i, (p, by_sigma)) in points.iter().enumerate() {
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
            if let Some(Some(seen)) = normals.get(i) {
                out.cross(p, &n, seen, weight);
            }
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

    /// Adds the products of a point's two normals.
    fn cross(&mut self, p: &Vec3, n: &Vec3, seen: &Vec3, weight: f64) {
        let row = |n: &Vec3| {
            let turn = p.cross(n);
            Vector6::new(n.x, n.y, n.z, turn.x, turn.y, turn.z)
        };
        let (a, b) = (row(n), row(seen));
        self.own += a * a.transpose() * weight;
        self.crossed += a * b.transpose() * weight;
    }

    /// The share of the curvature along a direction that is not noise: 0 where most of it is.
    fn sound(&self, direction: &Vector6<f64>) -> f64 {
        let own = direction.dot(&(self.own * direction));
        let share = direction.dot(&(self.crossed * direction)) / own;
        if own > 0.0 { ((share - MOSTLY_NOISE) / (1.0 - MOSTLY_NOISE)).clamp(0.0, 1.0) } else { 1.0 }
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
        let least = CORRELATED * self.variance() / (config.fixed_m * config.fixed_m);
        for i in 0..6 {
            let direction: Vector6<f64> = eigen.eigenvectors.column(i).into();
            let curvature = eigen.eigenvalues[i];
            if curvature.is_finite() && curvature * self.sound(&direction) >= least {
                step -= direction * (direction.dot(&self.gradient) / curvature);
            } else {
                free.push(direction);
            }
        }
        (step, free)
    }

    /// The unconstrained directions, as many as [`Self::solve`] gives. Noise turns those of the Hessian: 3 degrees in the normals amount to
    /// 0.1 degree for each 7 cm along a wall. So they are those of the products of both normals, where there are any.
    fn free(&self, config: &TrackConfig) -> Vec<Vector6<f64>> {
        let (_, free) = self.solve(config);
        if self.own.trace() <= 0.0 {
            return free;
        }
        let eigen = SymmetricEigen::new((self.crossed + self.crossed.transpose()) * 0.5);
        let mut least: Vec<(f64, Vector6<f64>)> =
            (0..6).map(|i| (eigen.eigenvalues[i], eigen.eigenvectors.column(i).into())).collect();
        least.sort_by(|a, b| a.0.total_cmp(&b.0));
        least.into_iter().take(free.len()).map(|(_, direction)| direction).collect()
    }

    /// The step that the points and what was known before ask for together; `off` is the pose so far in the frame of the guess.
    /// With the information on the pose that they amount to.
    fn solve_with(&self, prior: &Matrix6<f64>, off: &Vector6<f64>) -> (Vector6<f64>, Matrix6<f64>) {
        let eigen = SymmetricEigen::new(self.hessian);
        let (mut information, mut right) = (*prior, -(prior * off));
        for i in 0..6 {
            let direction: Vector6<f64> = eigen.eigenvectors.column(i).into();
            let scale = self.sound(&direction) / (CORRELATED * self.variance());
            information += direction * direction.transpose() * (scale * eigen.eigenvalues[i].max(0.0));
            right -= direction * (scale * direction.dot(&self.gradient));
        }
        let step = information.cholesky().map_or_else(Vector6::zeros, |c| c.solve(&right));
        (step, information)
    }

    fn covariance(&self) -> Matrix6<f64> {
        let eigen = SymmetricEigen::new(self.hessian);
        let mut out = Matrix6::zeros();
        for i in 0..6 {
            let direction: Vector6<f64> = eigen.eigenvectors.column(i).into();
            let curvature = eigen.eigenvalues[i] * self.sound(&direction) / (CORRELATED * self.variance());
            out += direction * direction.transpose() / curvature.max(LEAST_INFORMATION);
        }
        out
    }
}
