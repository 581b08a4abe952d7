//! The pose along what the surface leaves free, from the shades on it: a bare wall that has a texture.
//!
//! Points of the present image, with their depth, against the gray image of an earlier view, coarse to fine: Kerl, Sturm and
//! Cremers, "Robust odometry estimation for RGB-D cameras" (ICRA 2013). Gain and offset of the brightness are estimated with the pose.
//! The surface has been aligned before ([`crate::track_from`]) and decides the directions that it fixes: depth that is
//! not registered to its pictures exactly would bend these. Noise in the gradients makes a blank wall look textured, as noise in normals
//! does in `track.rs`: so a direction counts by products of the gradients of both images, whose noise is independent. Where the two do
//! not show the same texture the products cancel, and nothing is taken from them.

use crate::shaded::{ShadedView, Shades};
use crate::{DenseTracked, TrackConfig};
use cairn_geometry::{Manifold, Se3, Vec3};
use nalgebra::{DMatrix, DVector, Matrix6, Matrix6xX, SMatrix, SVector, SymmetricEigen, Vector6};

/// Points on each level, at most about this many.
const POINTS: f64 = 1500.0;
/// Iterations on each level.
const ITERATIONS: usize = 10;
/// Standard deviation of a shade, and where outliers begin.
const SIGMA: f64 = 3.0;
const HUBER: f64 = 8.0;
/// Errors of neighbouring points are correlated: as if only one in so many were independent.
const CORRELATED: f64 = 16.0;
/// A point is behind something else, or before it, where its depth differs by more than this share and so many metres.
const HIDDEN: [f64; 2] = [0.03, 0.02];
/// With a smaller share of the points in the earlier view nothing is aligned.
const LEAST_SHARE: f64 = 0.3;
const LEAST_POINTS: usize = 50;
/// A direction is mostly noise when less than this share of its curvature is confirmed by the other image.
const MOSTLY_NOISE: f64 = 0.25;
/// A step of so many standard deviations ends a level.
const STILL: f64 = 0.1;
/// Where the last step is longer than so many standard deviations, the shades say nothing.
const SMALL: f64 = 1.0;
/// The shades tell a direction with at most this standard deviation, metres or radians: what tells less may as well be a stain on the lens.
const TOLD_M: f64 = 0.004;
/// Information on a direction of which nothing is told: a standard deviation of 10 m or rad.
const LEAST_INFORMATION: f64 = 0.01;
/// Least and greatest gain of the brightness.
const GAIN: [f64; 2] = [0.5, 2.0];

/// Moves a pose that the surface left free in some directions to where the shades of `now` are those of `before`. `known` is the covariance of
/// the guess that the surface was aligned from. `None` where no free direction is found by the shades.
pub fn track_photometric(
    before: &ShadedView,
    volume_from_before: &Se3,
    now: &ShadedView,
    tracked: &DenseTracked,
    known: &Matrix6<f64>,
    config: &TrackConfig,
) -> Option<DenseTracked> {
    if tracked.free.is_empty() {
        return None;
    }
    let free = Matrix6xX::from_columns(&tracked.free);
    let known = free.transpose() * known.try_inverse()? * &free;
    let start = tracked.volume_from_camera;
    let pair = Pair { before, now, before_from_volume: volume_from_before.inverse() };
    let (mut pose, mut brightness) = (start, [1.0, 0.0]);
    let mut last_step = f64::INFINITY;
    for level in (0..before.levels.len().min(now.levels.len())).rev() {
        let points = pair.points(level);
        for _ in 0..ITERATIONS {
            let rows = Rows::build(&pair, level, &points, &pose, brightness);
            if !rows.suffice(points.len()) {
                return None;
            }
            let (hessian, gradient) = rows.of_pose()?;
            let scale = 1.0 / (CORRELATED * rows.variance());
            let off = free.transpose() * start.local(&pose);
            let right: DVector<f64> = -(free.transpose() * gradient * scale + &known * off);
            let all: DMatrix<f64> = free.transpose() * hessian * scale * &free + &known;
            let step = all.clone().cholesky()?.solve(&right);
            last_step = step.dot(&(all * &step)).sqrt();
            let step: Vector6<f64> = &free * step;
            brightness = rows.brightness(brightness, &step)?;
            pose = pose.retract(&step);
            if !pose.is_finite() {
                return None;
            }
            if last_step < STILL {
                break;
            }
        }
    }
    let points = pair.points(0);
    let rows = Rows::build(&pair, 0, &points, &pose, brightness);
    let is_alike = (GAIN[0]..=GAIN[1]).contains(&brightness[0]);
    if !(last_step < SMALL && is_alike && rows.suffice(points.len())) {
        return None;
    }
    rows.found(tracked, &free, &pose, config)
}

/// Two views, and where the earlier is.
struct Pair<'a> {
    before: &'a ShadedView,
    now: &'a ShadedView,
    before_from_volume: Se3,
}

/// A point of the present view, with its shade and the gradient of it by position.
struct Point {
    at: Vec3,
    shade: f64,
    gradient: Vec3,
}

impl Pair<'_> {
    /// In each square of pixels of a level of the present view the one with the greatest gradient, if it has a depth.
    fn points(&self, level: usize) -> Vec<Point> {
        let shades = &self.now.levels[level];
        let (w, h) = (shades.image.width(), shades.image.height());
        let side = ((w * h) as f64 / POINTS).sqrt().ceil().max(1.0) as usize;
        let mut out = Vec::with_capacity((w / side + 1) * (h / side + 1));
        for top in (1..h.saturating_sub(2)).step_by(side) {
            for left in (1..w.saturating_sub(2)).step_by(side) {
                out.extend(self.steepest(shades, level, [left, top], side));
            }
        }
        out
    }

    fn steepest(&self, shades: &Shades, level: usize, [left, top]: [usize; 2], side: usize) -> Option<Point> {
        let image = &shades.image;
        let mut best: Option<(f32, [usize; 2])> = None;
        for y in top..(top + side).min(image.height() - 2) {
            for x in left..(left + side).min(image.width() - 2) {
                let dx = image.at(x + 1, y) - image.at(x - 1, y);
                let dy = image.at(x, y + 1) - image.at(x, y - 1);
                let square = dx * dx + dy * dy;
                if best.is_none_or(|(most, _)| square > most) {
                    best = Some((square, [x, y]));
                }
            }
        }
        let (_, [x, y]) = best?;
        let (x, y) = (x as f64, y as f64);
        let z = self.now.depth_m(level, x, y)?;
        let c = &shades.camera;
        let at = Vec3::new((x - c.cx) / c.fx, (y - c.cy) / c.fy, 1.0) * z;
        let [shade, dx, dy] = shades.at(x, y)?;
        Some(Point { at, shade, gradient: by_position(shades, &at, [dx, dy]) })
    }

    /// Shade of the earlier view at a point of it, and the gradient by position; `None` where it is not seen.
    #[inline]
    fn seen_before(&self, level: usize, at: &Vec3) -> Option<(f64, Vec3)> {
        let shades = &self.before.levels[level];
        let c = &shades.camera;
        if at.z < 0.05 {
            return None;
        }
        let (x, y) = (at.x / at.z * c.fx + c.cx, at.y / at.z * c.fy + c.cy);
        let [shade, dx, dy] = shades.at(x, y)?;
        let z = self.before.depth_m(level, x, y)?;
        let is_seen = (z - at.z).abs() < HIDDEN[0] * z + HIDDEN[1];
        is_seen.then(|| (shade, by_position(shades, at, [dx, dy])))
    }
}

/// How a shade changes with the position of its point, from how it changes with the pixel.
#[inline]
fn by_position(shades: &Shades, at: &Vec3, [dx, dy]: [f64; 2]) -> Vec3 {
    let (gx, gy) = (dx * shades.camera.fx / at.z, dy * shades.camera.fy / at.z);
    Vec3::new(gx, gy, -(gx * at.x + gy * at.y) / at.z)
}

/// How something changes with a right perturbation of the pose, from how it changes with the position of its point.
#[inline]
fn by_pose(at: &Vec3, gradient: &Vec3) -> Vector6<f64> {
    let turn = at.cross(gradient);
    Vector6::new(gradient.x, gradient.y, gradient.z, turn.x, turn.y, turn.z)
}

/// Normal equations of the pose (right perturbation) and of gain and offset of the brightness.
struct Rows {
    hessian: SMatrix<f64, 8, 8>,
    gradient: SVector<f64, 8>,
    /// The Hessian of the pose, and the same as products of the gradients of both images.
    own: Matrix6<f64>,
    crossed: Matrix6<f64>,
    used: usize,
    /// Sum of squared whitened differences with their weights.
    cost: f64,
}

impl Rows {
    fn build(pair: &Pair, level: usize, points: &[Point], pose: &Se3, [gain, offset]: [f64; 2]) -> Self {
        let before_from_now = pair.before_from_volume * *pose;
        let (turn, shift) = (before_from_now.rotation.matrix(), before_from_now.translation);
        let mut out = Self {
            hessian: SMatrix::zeros(),
            gradient: SVector::zeros(),
            own: Matrix6::zeros(),
            crossed: Matrix6::zeros(),
            used: 0,
            cost: 0.0,
        };
        for point in points {
            let Some((shade, gradient)) = pair.seen_before(level, &(turn * point.at + shift)) else {
                continue;
            };
            let off = shade - gain * point.shade - offset;
            let robust = if off.abs() <= HUBER { 1.0 } else { HUBER / off.abs() };
            let weight = robust / (SIGMA * SIGMA);
            let a = by_pose(&point.at, &(turn.transpose() * gradient));
            let b = by_pose(&point.at, &(point.gradient * gain));
            let mut row = SVector::<f64, 8>::zeros();
            row.fixed_rows_mut::<6>(0).copy_from(&a);
            (row[6], row[7]) = (-point.shade, -1.0);
            out.hessian += row * row.transpose() * weight;
            out.gradient += row * (off * weight);
            out.own += a * a.transpose() * weight;
            out.crossed += a * b.transpose() * weight;
            out.used += 1;
            out.cost += weight * off * off;
        }
        out
    }

    fn suffice(&self, tried: usize) -> bool {
        self.used >= LEAST_POINTS && self.used as f64 >= LEAST_SHARE * tried as f64
    }

    /// Variance of a whitened difference; one when the noise is as modelled.
    fn variance(&self) -> f64 {
        (self.cost / (self.used.max(9) - 8) as f64).max(1.0)
    }

    /// The inverse of what gain and offset have; they are held where there is nothing to tell them by.
    fn of_brightness(&self) -> Option<SMatrix<f64, 2, 2>> {
        let own = self.hessian.fixed_view::<2, 2>(6, 6).into_owned();
        (own + SMatrix::<f64, 2, 2>::identity() * (1e-9 * own.trace() + 1e-12)).try_inverse()
    }

    /// Hessian and gradient of the pose where gain and offset are free.
    fn of_pose(&self) -> Option<(Matrix6<f64>, Vector6<f64>)> {
        let across = self.hessian.fixed_view::<6, 2>(0, 6) * self.of_brightness()?;
        let hessian = self.hessian.fixed_view::<6, 6>(0, 0) - across * self.hessian.fixed_view::<2, 6>(6, 0);
        let gradient = self.gradient.fixed_rows::<6>(0) - across * self.gradient.fixed_rows::<2>(6);
        Some((hessian, gradient))
    }

    /// Gain and offset after a step of the pose.
    fn brightness(&self, [gain, offset]: [f64; 2], step: &Vector6<f64>) -> Option<[f64; 2]> {
        let right = self.gradient.fixed_rows::<2>(6) + self.hessian.fixed_view::<2, 6>(6, 0) * step;
        let by = self.of_brightness()? * right;
        Some([gain - by[0], offset - by[1]])
    }

    /// The share of the curvature along a direction that is not noise: 0 where most of it is.
    fn sound(&self, direction: &Vector6<f64>) -> f64 {
        let own = direction.dot(&(self.own * direction));
        let share = direction.dot(&(self.crossed * direction)) / own;
        if own > 0.0 { ((share - MOSTLY_NOISE) / (1.0 - MOSTLY_NOISE)).clamp(0.0, 1.0) } else { 0.0 }
    }

    /// The pose in the directions that the shades tell, with what is left free; `None` where they tell none.
    fn found(
        &self,
        tracked: &DenseTracked,
        free: &Matrix6xX<f64>,
        pose: &Se3,
        config: &TrackConfig,
    ) -> Option<DenseTracked> {
        let (hessian, _) = self.of_pose()?;
        let eigen = SymmetricEigen::new(free.transpose() * hessian * free);
        let scale = 1.0 / (CORRELATED * self.variance());
        let off = tracked.volume_from_camera.local(pose);
        let (mut step, mut left) = (Vector6::zeros(), Vec::new());
        let least = config.fixed_m.min(TOLD_M).powi(-2);
        // Of the free directions the surface says nothing, whatever noise makes of them.
        let fixed = Matrix6::identity() - free * free.transpose();
        let mut information = fixed * tracked.covariance.try_inverse()? * fixed;
        information += free * free.transpose() * LEAST_INFORMATION;
        for (i, curvature) in eigen.eigenvalues.iter().enumerate() {
            let direction: Vector6<f64> = free * eigen.eigenvectors.column(i);
            let told = curvature * scale * self.sound(&direction);
            if told.is_finite() && told >= least {
                step += direction * direction.dot(&off);
                information += direction * direction.transpose() * told;
            } else {
                left.push(direction);
            }
        }
        (left.len() < tracked.free.len()).then_some(DenseTracked {
            volume_from_camera: tracked.volume_from_camera.retract(&step),
            covariance: information.try_inverse()?,
            free: left,
            ..tracked.clone()
        })
    }
}
