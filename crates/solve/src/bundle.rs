//! Bundle adjustment: poses of ideal pinholes, points, numbers of the calibration, and whatever further factors are given
//! (IMU factors, say), by Levenberg-Marquardt on the reduced camera system, which is solved sparsely.
//!
//! Source: Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6.

use crate::factors::{Equations, Factors, NoFactors, Variable};
use crate::levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt, Problem, Trial};
use crate::reprojection::{Linear, View};
use crate::schur::{Border, More, Normal, Schur, Step};
use crate::slices::{pause, to_end};
use crate::{CHI2_2, CHI2_3, Pinhole, Pixel, Report, Stop, huber};
use cairn_geometry::{Manifold, Mat3, Se3, Vec3};
use nalgebra::{SMatrix, SVector};

/// One point observed from one pose.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the pose.
    pub pose: u32,
    /// Index of the point.
    pub point: u32,
    /// Measured pixel.
    pub pixel: Pixel,
    /// Inverse variance, 1/px^2; 0 leaves the observation out.
    pub weight: f64,
}

/// How far a pose may move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Freedom {
    /// Anyhow.
    Free,
    /// Not at all.
    Fixed,
    /// It keeps its position and its heading about this unit vector of the world, and may tilt.
    Tilt(Vec3),
}

/// Added to every diagonal entry of the normal equations, so that directions nothing constrains stay put.
const FLOOR: f64 = 1e-8;
/// Information that keeps the heading of a pose that may only tilt, 1/rad^2.
const HEADING: f64 = 1e12;

/// The problem and, after [`Bundle::solve`], its solution.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// The camera of all poses that have none of their own.
    pub camera: Pinhole,
    /// The own camera of each pose; empty where none has one.
    pub own_cameras: Vec<Option<Pinhole>>,
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// How far each pose may move.
    pub freedom: Vec<Freedom>,
    /// Points in the world, metres.
    pub points: Vec<Vec3>,
    /// Observations, grouped by point: all of a point stand together.
    pub observations: Vec<Observation>,
    /// Numbers of the calibration.
    pub calibrations: Vec<Calibration>,
}

/// A number of the calibration that observed pixels depend on, known or estimated with poses and points.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Calibration {
    /// How pixels move with it.
    pub moves: Moves,
    /// Its value.
    pub value: f64,
    /// Mean of its prior,
    pub prior: f64,
    /// and its standard deviation, when it is to be estimated; 0 keeps the value.
    pub sigma: f64,
    /// True to compute only where it would move: it stays as it is, and so does what it would move.
    pub held: bool,
    /// After a solve: how far it would have moved, or moved, in the first step.
    pub pull: f64,
    /// After a solve: the information on it, prior and observations together, at the first state (and with its damping).
    pub information: f64,
}

/// By how much observed pixels move for each unit of a number of the calibration.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Moves {
    /// Every right x by one pixel: an error of the disparity of a stereo pair.
    #[default]
    Disparity,
    /// Each observation by so many pixels: the readout time of a rolling shutter, in seconds.
    Along(Vec<[f32; 2]>),
}

impl Moves {
    /// Those of an observation, by its index.
    #[inline(always)]
    fn of(&self, k: usize) -> [f64; 3] {
        match self {
            Self::Disparity => [0.0, 0.0, 1.0],
            Self::Along(slopes) => match slopes.get(k) {
                Some([x, y]) => [f64::from(*x), f64::from(*y), f64::from(*x)],
                None => [0.0; 3],
            },
        }
    }

    /// The derivative of an observation's residual: its third row is right x less x.
    #[inline(always)]
    fn of_residual(&self, k: usize) -> [f64; 3] {
        let [x, y, right_x] = self.of(k);
        [x, y, right_x - x]
    }
}

impl Calibration {
    fn is_estimated(&self) -> bool {
        self.sigma > 0.0
    }

    /// Information of its prior.
    fn prior_information(&self) -> f64 {
        if self.is_estimated() { self.sigma.powi(-2) } else { 0.0 }
    }

    fn prior_cost(&self, value: f64) -> f64 {
        0.5 * self.prior_information() * (value - self.prior).powi(2)
    }
}

/// Settings of [`Bundle::solve`].
#[derive(Clone, Copy, Debug)]
pub struct BundleConfig {
    /// Maximum number of steps, rejected ones included.
    pub iterations: usize,
    /// Whether Huber's loss is used for observations.
    pub robust: bool,
    /// Converged when a step lowers the cost by less than this part of it.
    pub tolerance: f64,
    /// Damping of the first step, relative to the diagonal of the normal equations.
    pub first_damping: f64,
}

impl Default for BundleConfig {
    fn default() -> Self {
        Self { iterations: 10, robust: true, tolerance: 1e-4, first_damping: 1e-5 }
    }
}

impl Bundle {
    /// The camera of a pose.
    #[inline(always)]
    fn camera_of(&self, pose: u32) -> &Pinhole {
        self.own_cameras.get(pose as usize).and_then(Option::as_ref).unwrap_or(&self.camera)
    }

    /// Squared whitened residual of an observation, by its index; infinite behind the camera.
    pub fn chi2_of(&self, k: usize) -> f64 {
        let o = &self.observations[k];
        let shift = shift(&self.calibrations, values(&self.calibrations), k);
        let q = View::new(&self.poses[o.pose as usize]).to_camera(&self.points[o.point as usize]);
        match self.camera_of(o.pose).residual(&q, &shifted(&o.pixel, &shift)) {
            Some(r) => (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight,
            None => f64::INFINITY,
        }
    }

    /// The 95 % bound of an observation's chi-square.
    pub fn bound(o: &Observation) -> f64 {
        if o.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 }
    }

    /// Half the sum of the losses of the observations, and the cost of the priors of the calibration.
    pub fn observation_cost(&self, robust: bool) -> f64 {
        self.cost(&self.poses, &self.points, &values(&self.calibrations).collect::<Vec<_>>(), robust)
    }

    /// Variance of the residuals at a cost of the observations, in units of what their weights say; 1 where the unknowns
    /// could fit all of them.
    pub fn residual_variance(&self, cost: f64) -> f64 {
        let used = self.observations.iter().filter(|o| o.weight > 0.0);
        let rows: usize = used.map(|o| if o.pixel[2].is_nan() { 2 } else { 3 }).sum();
        let free = self.freedom.iter().filter(|f| **f != Freedom::Fixed).count();
        let unknowns = 6 * free + 3 * self.points.len();
        let variance = 2.0 * cost / (rows as f64 - unknowns as f64);
        if rows > unknowns && variance > 0.0 { variance } else { 1.0 }
    }

    /// Lowers the cost of the observations; asks `stop` before each step.
    pub fn solve(&mut self, config: &BundleConfig, stop: impl FnMut() -> bool) -> Report {
        self.solve_with(&mut NoFactors, config, stop)
    }

    /// The same with further factors and their variables, which are solved for too.
    pub fn solve_with<F: Factors + ?Sized>(
        &mut self,
        factors: &mut F,
        config: &BundleConfig,
        stop: impl FnMut() -> bool,
    ) -> Report {
        to_end(self.solve_in_slices(factors, config, stop))
    }

    /// The same in slices.
    pub async fn solve_in_slices<F: Factors + ?Sized>(
        &mut self,
        factors: &mut F,
        config: &BundleConfig,
        stop: impl FnMut() -> bool,
    ) -> Report {
        let mut report =
            Report { iterations: 0, cost_before: 0.0, cost_after: 0.0, inliers: 0, stop: Stop::Empty };
        let mut adjustment = Adjustment::new(self, factors, config.robust);
        if adjustment.is_empty() {
            return report;
        }
        pause().await;
        let solver = LevenbergMarquardt {
            iterations: config.iterations,
            damping: Damping::Factors {
                first: config.first_damping,
                least: 1e-9,
                most: 1e6,
                shrink: 0.2,
                grow: 10.0,
                restart: 0.0,
            },
            convergence: Convergence::Actual { relative: config.tolerance },
        };
        let outcome = solver.minimise_in_slices(&mut adjustment, stop).await;
        (report.iterations, report.stop) = (outcome.iterations, outcome.stop);
        (report.cost_before, report.cost_after) = (outcome.cost_before, outcome.cost_after);
        let fits = |k: &usize| self.chi2_of(*k) <= Self::bound(&self.observations[*k]);
        let used = (0..self.observations.len()).filter(|k| self.observations[*k].weight > 0.0);
        report.inliers = used.filter(fits).count();
        report
    }

    /// Covariance over (translation, rotation) of a pose with everything else marginalised, from the equations at this
    /// state. `None` for a pose that is fixed or does not exist, and where the observations do not determine it.
    pub fn pose_covariance<F: Factors + ?Sized>(
        &mut self,
        factors: &mut F,
        pose: usize,
        robust: bool,
    ) -> Option<SMatrix<f64, 6, 6>> {
        let mut adjustment = Adjustment::new(self, factors, robust);
        let slot = adjustment.slot.get(pose).copied().flatten()?;
        to_end(adjustment.linearise())?;
        let Adjustment { bundle, schur, normal, .. } = &mut adjustment;
        to_end(schur.covariance(normal, &bundle.couplings(robust), slot as usize, FLOOR))
    }

    /// For each pose its block row, when it is free.
    fn slots(&self) -> Vec<Option<u32>> {
        let mut next = 0;
        self.freedom
            .iter()
            .map(|freedom| {
                (*freedom != Freedom::Fixed).then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect()
    }

    fn cost(&self, poses: &[Se3], points: &[Vec3], trial: &[f64], robust: bool) -> f64 {
        let views: Vec<View> = poses.iter().map(View::new).collect();
        let mut cost = 0.0;
        self.calibrations.iter().zip(trial).for_each(|(c, value)| cost += c.prior_cost(*value));
        for (k, o) in self.observations.iter().enumerate().filter(|(_, o)| o.weight > 0.0) {
            let q = views[o.pose as usize].to_camera(&points[o.point as usize]);
            let shift = shift(&self.calibrations, trial.iter().copied(), k);
            let Some(r) = self.camera_of(o.pose).residual(&q, &shifted(&o.pixel, &shift)) else {
                return f64::INFINITY;
            };
            let chi2 = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight;
            cost += 0.5 * if robust { huber(chi2, Self::bound(o)).0 } else { chi2 };
        }
        cost
    }

    /// Fills the normal equations with the observations and the priors of the calibration.
    fn linearise(
        &mut self,
        slot: &[Option<u32>],
        normal: &mut Normal<6>,
        borders: &mut [Border<6>],
        robust: bool,
    ) {
        let views: Vec<View> = self.poses.iter().map(View::new).collect();
        let estimated: Vec<&Calibration> = self.calibrations.iter().filter(|c| c.is_estimated()).collect();
        for (border, c) in borders.iter_mut().zip(&estimated) {
            let information = c.prior_information();
            (border.hessian, border.gradient) = (information, information * (c.value - c.prior));
            border.earlier.fill(0.0);
            border.cameras.fill(SVector::zeros());
            border.points.fill(Vec3::zeros());
        }
        self.calibrations.iter().for_each(|c| normal.cost += c.prior_cost(c.value));
        for (k, o) in self.observations.iter_mut().enumerate() {
            if o.weight <= 0.0 {
                continue;
            }
            let shift = shift(&self.calibrations, values(&self.calibrations), k);
            let camera =
                self.own_cameras.get(o.pose as usize).and_then(Option::as_ref).unwrap_or(&self.camera);
            let (view, point) = (&views[o.pose as usize], o.point as usize);
            let Some(seen) = Seen::of(camera, view, &self.points[point], o, &shift, robust) else {
                // An observation of a point behind the camera cannot be fitted: it is left out.
                o.weight = 0.0;
                continue;
            };
            let (l, w, by_point) = (&seen.linear, seen.weight, seen.by_point());
            let r = Vec3::from(l.residual);
            normal.cost += 0.5 * seen.loss;
            normal.points[point] += by_point * by_point.transpose() * w;
            normal.point_gradients[point] += by_point * r * w;
            let slot = slot[o.pose as usize].map(|s| s as usize);
            let rows = if o.pixel[2].is_nan() { 2 } else { 3 };
            for (border, c) in borders.iter_mut().zip(&estimated) {
                let moves = c.moves.of_residual(k);
                for i in (0..rows).filter(|i| moves[*i] != 0.0) {
                    let m = w * moves[i];
                    border.hessian += m * moves[i];
                    let earlier = border.earlier.iter_mut().zip(&estimated);
                    earlier.for_each(|(e, other)| *e += m * other.moves.of_residual(k)[i]);
                    border.gradient += m * r[i];
                    border.points[point] += Vec3::from(l.by_point[i]) * m;
                    if let Some(s) = slot {
                        border.cameras[s] += SVector::<f64, 6>::from(l.by_pose[i]) * m;
                    }
                }
            }
            if let Some(s) = slot {
                let by_pose = seen.by_pose();
                let weighted = by_pose * w;
                normal.cameras[s] += weighted * by_pose.transpose();
                normal.camera_gradients[s] += weighted * r;
            }
        }
    }

    /// Gives each observation's block of the normal equations, pose by point, at this state; zero for those left out.
    fn couplings(&self, robust: bool) -> impl Fn(usize) -> SMatrix<f64, 6, 3> {
        let views: Vec<View> = self.poses.iter().map(View::new).collect();
        move |k| {
            let o = &self.observations[k];
            let (view, point) = (&views[o.pose as usize], &self.points[o.point as usize]);
            let shift = shift(&self.calibrations, values(&self.calibrations), k);
            let seen =
                (o.weight > 0.0).then(|| Seen::of(self.camera_of(o.pose), view, point, o, &shift, robust));
            seen.flatten().map_or_else(SMatrix::zeros, |seen| {
                let weighted = seen.by_pose() * seen.weight;
                weighted * seen.by_point().transpose()
            })
        }
    }

    /// Poses and points after a step.
    fn moved(&self, slot: &[Option<u32>], step: &Step<6>) -> (Vec<Se3>, Vec<Vec3>) {
        let poses = self.poses.iter().zip(slot).map(|(pose, slot)| match slot {
            Some(k) => pose.retract(&step.cameras[*k as usize]),
            None => *pose,
        });
        (poses.collect(), self.points.iter().zip(&step.points).map(|(p, d)| p + d).collect())
    }
}

/// An observation, linearised.
struct Seen {
    linear: Linear,
    loss: f64,
    /// Inverse variance with the slope of the loss.
    weight: f64,
}

impl Seen {
    /// `None` behind the camera.
    #[inline(always)]
    fn of(
        camera: &Pinhole,
        view: &View,
        point: &Vec3,
        o: &Observation,
        shift: &[f64; 3],
        robust: bool,
    ) -> Option<Self> {
        let linear = camera.linearise(view, point, &shifted(&o.pixel, shift))?;
        let chi2 = Vec3::from(linear.residual).norm_squared() * o.weight;
        let (loss, slope) = if robust { huber(chi2, Bundle::bound(o)) } else { (chi2, 1.0) };
        Some(Self { linear, loss, weight: slope * o.weight })
    }

    /// Rows of the Jacobian by the point, held as columns.
    fn by_point(&self) -> Mat3 {
        Mat3::from_columns(&self.linear.by_point.map(Vec3::from))
    }

    /// The same by the pose.
    fn by_pose(&self) -> SMatrix<f64, 6, 3> {
        SMatrix::<f64, 6, 3>::from_columns(&self.linear.by_pose.map(SVector::<f64, 6>::from))
    }
}

/// A bundle while it is solved.
struct Adjustment<'a, F: ?Sized> {
    bundle: &'a mut Bundle,
    factors: &'a mut F,
    robust: bool,
    slot: Vec<Option<u32>>,
    schur: Schur<6>,
    normal: Normal<6>,
    /// Of the numbers of the calibration that are estimated.
    borders: Vec<Border<6>>,
    trial: (Vec<Se3>, Vec<Vec3>, Vec<f64>),
    /// Whether the information on the calibration is known. Later steps may be damped much more, which looks like
    /// information.
    has_asked: bool,
}

impl<'a, F: Factors + ?Sized> Adjustment<'a, F> {
    fn new(bundle: &'a mut Bundle, factors: &'a mut F, robust: bool) -> Self {
        let slot = bundle.slots();
        let free = slot.iter().flatten().count();
        let more = more(bundle, factors, &slot, free);
        let views = bundle.observations.iter().map(|o| (o.point as usize, slot[o.pose as usize]));
        let schur = Schur::new(free, bundle.points.len(), views, more);
        let estimated = bundle.calibrations.iter().filter(|c| c.is_estimated());
        let border = |(earlier, c): (usize, &Calibration)| Border {
            earlier: vec![0.0; earlier],
            cameras: vec![SVector::zeros(); free],
            points: vec![Vec3::zeros(); bundle.points.len()],
            held: c.held,
            ..Border::default()
        };
        let borders = estimated.enumerate().map(border).collect();
        let normal = schur.normal();
        Self {
            bundle,
            factors,
            robust,
            slot,
            schur,
            normal,
            borders,
            trial: Default::default(),
            has_asked: false,
        }
    }

    /// Whether there is nothing to solve for or nothing to solve it by.
    fn is_empty(&self) -> bool {
        let unknown = self.schur.rows() > 0 || !self.bundle.points.is_empty();
        !unknown || (self.bundle.observations.is_empty() && self.factors.is_empty())
    }
}

/// The variables and factors that a bundle has beside poses, points and observations.
fn more<F: Factors + ?Sized>(bundle: &Bundle, factors: &F, slot: &[Option<u32>], free: usize) -> More {
    let row = |v: &Variable| match v {
        Variable::Pose(i) => slot.get(*i).copied().flatten().map(|s| s as usize),
        Variable::Own(i) => Some(free + i),
    };
    let mut pairs = Vec::new();
    factors.scopes(&mut |scope| {
        let rows: Vec<usize> = scope.iter().filter_map(row).collect();
        for (i, a) in rows.iter().enumerate() {
            pairs.extend(rows[..i].iter().map(|b| (*a, *b)));
        }
    });
    let tilting = bundle.freedom.iter().zip(slot).filter(|(f, _)| matches!(f, Freedom::Tilt(_)));
    let mut held: Vec<_> = tilting.filter_map(|(_, s)| Some(((*s)? as usize, 0..3))).collect();
    held.extend(factors.held().into_iter().map(|(own, components)| (free + own, components)));
    More { sizes: factors.sizes(), pairs, held }
}

impl<F: Factors + ?Sized> Problem for Adjustment<'_, F> {
    async fn linearise(&mut self) -> Option<f64> {
        self.normal.clear();
        self.bundle.linearise(&self.slot, &mut self.normal, &mut self.borders, self.robust);
        pause().await;
        let mut equations = Equations::new(&mut self.normal, &self.slot);
        self.factors.linearise(&self.bundle.poses, &mut equations)?;
        for ((freedom, slot), pose) in self.bundle.freedom.iter().zip(&self.slot).zip(&self.bundle.poses) {
            if let (Freedom::Tilt(up), Some(slot)) = (freedom, slot) {
                let up = pose.rotation.inverse() * *up;
                let mut rotation = self.normal.cameras[*slot as usize].fixed_view_mut::<3, 3>(3, 3);
                rotation += up * up.transpose() * HEADING;
            }
        }
        Some(self.normal.cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let couplings = self.bundle.couplings(self.robust);
        let step = self.schur.step(&self.normal, &couplings, &self.borders, damping, FLOOR).await;
        drop(couplings);
        let first = !std::mem::replace(&mut self.has_asked, true);
        let step = step?;
        let mut values: Vec<f64> = values(&self.bundle.calibrations).collect();
        let calibrations = self.bundle.calibrations.iter_mut().zip(&mut values);
        for ((c, value), border) in calibrations.filter(|(c, _)| c.is_estimated()).zip(&step.borders) {
            if first {
                (c.information, c.pull) = (border.information, border.pull);
            }
            *value += border.step;
        }
        pause().await;
        let (poses, points) = self.bundle.moved(&self.slot, &step);
        let mut cost = self.bundle.cost(&poses, &points, &values, self.robust);
        cost += self.factors.attempt(&poses, &step.more);
        self.trial = (poses, points, values);
        Some(Trial { cost, predicted_decrease: step.promise })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.bundle.poses, &mut self.trial.0);
        std::mem::swap(&mut self.bundle.points, &mut self.trial.1);
        self.bundle.calibrations.iter_mut().zip(&self.trial.2).for_each(|(c, value)| c.value = *value);
        self.factors.accept();
    }
}

/// A pixel moved, and that of the right image.
#[inline(always)]
fn shifted(pixel: &Pixel, shift: &[f64; 3]) -> Pixel {
    [pixel[0] + shift[0], pixel[1] + shift[1], pixel[2] + shift[2]]
}

/// The numbers of the calibration.
fn values(calibrations: &[Calibration]) -> impl Iterator<Item = f64> {
    calibrations.iter().map(|c| c.value)
}

/// By how much the calibration moves an observation, at some values of its numbers.
#[inline(always)]
fn shift(calibrations: &[Calibration], values: impl Iterator<Item = f64>, k: usize) -> [f64; 3] {
    let mut shift = [0.0; 3];
    for (c, value) in calibrations.iter().zip(values) {
        let moves = c.moves.of(k);
        (0..3).for_each(|i| shift[i] += moves[i] * value);
    }
    shift
}

#[cfg(test)]
mod tests;
