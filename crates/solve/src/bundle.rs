//! Bundle adjustment: poses of ideal pinholes, points, a disparity error, and whatever further factors are given (IMU
//! factors, say), by Levenberg-Marquardt on the reduced camera system, which is solved sparsely.
//!
//! Source: Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6.

use crate::factors::{Equations, Factors, NoFactors, Variable};
use crate::levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt, Problem, Trial};
use crate::reprojection::{Linear, View};
use crate::schur::{Border, More, Normal, Schur, Step};
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
    /// The camera of all poses.
    pub camera: Pinhole,
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// How far each pose may move.
    pub freedom: Vec<Freedom>,
    /// Points in the world, metres.
    pub points: Vec<Vec3>,
    /// Observations, grouped by point: all of a point stand together.
    pub observations: Vec<Observation>,
    /// The disparity error of the stereo calibration.
    pub right_offset: RightOffset,
}

/// What is added to every measured right x, pixels: the error of a stereo calibration that looks like disparity.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RightOffset {
    /// Its value.
    pub value: f64,
    /// Mean of its prior, pixels,
    pub prior: f64,
    /// and its standard deviation, when it is to be estimated; 0 keeps the value.
    pub sigma: f64,
    /// True to compute only where it would move: it stays as it is, and so does what it would move.
    pub held: bool,
    /// After a solve: how far it would have moved, or moved, in the first step, pixels.
    pub pull: f64,
    /// After a solve: the information on it, prior and observations together, at the first state (and with its damping):
    /// 1/px^2.
    pub information: f64,
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
    /// Squared whitened residual of an observation; infinite behind the camera.
    pub fn chi2(&self, o: &Observation) -> f64 {
        let q = View::new(&self.poses[o.pose as usize]).to_camera(&self.points[o.point as usize]);
        match self.camera.residual(&q, &shifted(&o.pixel, self.right_offset.value)) {
            Some(r) => (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight,
            None => f64::INFINITY,
        }
    }

    /// The 95 % bound of an observation's chi-square.
    pub fn bound(o: &Observation) -> f64 {
        if o.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 }
    }

    /// Half the sum of the losses of the observations, and the cost of the prior of the right offset.
    pub fn observation_cost(&self, robust: bool) -> f64 {
        self.cost(&self.poses, &self.points, self.right_offset.value, robust)
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
    pub fn solve_with<F: Factors>(
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
        let outcome = solver.minimise(&mut adjustment, stop);
        (report.iterations, report.stop) = (outcome.iterations, outcome.stop);
        (report.cost_before, report.cost_after) = (outcome.cost_before, outcome.cost_after);
        report.inliers =
            self.observations.iter().filter(|o| o.weight > 0.0 && self.chi2(o) <= Self::bound(o)).count();
        report
    }

    /// Covariance over (translation, rotation) of a pose with everything else marginalised, from the equations at this
    /// state. `None` for a pose that is fixed or does not exist, and where the observations do not determine it.
    pub fn pose_covariance<F: Factors>(
        &mut self,
        factors: &mut F,
        pose: usize,
        robust: bool,
    ) -> Option<SMatrix<f64, 6, 6>> {
        let mut adjustment = Adjustment::new(self, factors, robust);
        let slot = adjustment.slot.get(pose).copied().flatten()?;
        adjustment.linearise()?;
        let Adjustment { bundle, schur, normal, .. } = &mut adjustment;
        schur.covariance(normal, &bundle.couplings(robust), slot as usize, FLOOR)
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

    /// Information of the prior of the right offset, 1/px^2.
    fn offset_information(&self) -> f64 {
        if self.right_offset.sigma > 0.0 { self.right_offset.sigma.powi(-2) } else { 0.0 }
    }

    fn cost(&self, poses: &[Se3], points: &[Vec3], offset: f64, robust: bool) -> f64 {
        let views: Vec<View> = poses.iter().map(View::new).collect();
        let mut cost = 0.5 * self.offset_information() * (offset - self.right_offset.prior).powi(2);
        for o in self.observations.iter().filter(|o| o.weight > 0.0) {
            let q = views[o.pose as usize].to_camera(&points[o.point as usize]);
            let Some(r) = self.camera.residual(&q, &shifted(&o.pixel, offset)) else { return f64::INFINITY };
            let chi2 = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight;
            cost += 0.5 * if robust { huber(chi2, Self::bound(o)).0 } else { chi2 };
        }
        cost
    }

    /// Fills the normal equations with the observations and the prior of the right offset.
    fn linearise(
        &mut self,
        slot: &[Option<u32>],
        normal: &mut Normal<6>,
        mut border: Option<&mut Border<6>>,
        robust: bool,
    ) {
        let views: Vec<View> = self.poses.iter().map(View::new).collect();
        let (offset, information) = (self.right_offset.value, self.offset_information());
        let from_prior = offset - self.right_offset.prior;
        if let Some(border) = &mut border {
            (border.hessian, border.gradient) = (information, information * from_prior);
            border.cameras.fill(SVector::zeros());
            border.points.fill(Vec3::zeros());
        }
        normal.cost += 0.5 * information * from_prior.powi(2);
        for o in &mut self.observations {
            if o.weight <= 0.0 {
                continue;
            }
            let (view, point) = (&views[o.pose as usize], o.point as usize);
            let Some(seen) = Seen::of(&self.camera, view, &self.points[point], o, offset, robust) else {
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
            if let (Some(border), false) = (&mut border, o.pixel[2].is_nan()) {
                // Only the third row depends on the offset, with slope one.
                border.hessian += w;
                border.gradient += w * r[2];
                border.points[point] += Vec3::from(l.by_point[2]) * w;
                if let Some(s) = slot {
                    border.cameras[s] += SVector::<f64, 6>::from(l.by_pose[2]) * w;
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
        let offset = self.right_offset.value;
        move |k| {
            let o = &self.observations[k];
            let (view, point) = (&views[o.pose as usize], &self.points[o.point as usize]);
            let seen = (o.weight > 0.0).then(|| Seen::of(&self.camera, view, point, o, offset, robust));
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
        offset: f64,
        robust: bool,
    ) -> Option<Self> {
        let linear = camera.linearise(view, point, &shifted(&o.pixel, offset))?;
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
struct Adjustment<'a, F> {
    bundle: &'a mut Bundle,
    factors: &'a mut F,
    robust: bool,
    slot: Vec<Option<u32>>,
    schur: Schur<6>,
    normal: Normal<6>,
    /// Of the right offset, when it is to be estimated.
    border: Option<Border<6>>,
    trial: (Vec<Se3>, Vec<Vec3>, f64),
    /// Whether the information on the right offset is known. Later steps may be damped much more, which looks like
    /// information.
    has_asked: bool,
}

impl<'a, F: Factors> Adjustment<'a, F> {
    fn new(bundle: &'a mut Bundle, factors: &'a mut F, robust: bool) -> Self {
        let slot = bundle.slots();
        let free = slot.iter().flatten().count();
        let more = more(bundle, factors, &slot, free);
        let views = bundle.observations.iter().map(|o| (o.point as usize, slot[o.pose as usize]));
        let schur = Schur::new(free, bundle.points.len(), views, more);
        let border = (bundle.right_offset.sigma > 0.0).then(|| Border {
            cameras: vec![SVector::zeros(); free],
            points: vec![Vec3::zeros(); bundle.points.len()],
            held: bundle.right_offset.held,
            ..Border::default()
        });
        let normal = schur.normal();
        let trial = (Vec::new(), Vec::new(), bundle.right_offset.value);
        Self { bundle, factors, robust, slot, schur, normal, border, trial, has_asked: false }
    }

    /// Whether there is nothing to solve for or nothing to solve it by.
    fn is_empty(&self) -> bool {
        let unknown = self.schur.rows() > 0 || !self.bundle.points.is_empty();
        !unknown || (self.bundle.observations.is_empty() && self.factors.is_empty())
    }
}

/// The variables and factors that a bundle has beside poses, points and observations.
fn more<F: Factors>(bundle: &Bundle, factors: &F, slot: &[Option<u32>], free: usize) -> More {
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

impl<F: Factors> Problem for Adjustment<'_, F> {
    fn linearise(&mut self) -> Option<f64> {
        self.normal.clear();
        self.bundle.linearise(&self.slot, &mut self.normal, self.border.as_mut(), self.robust);
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

    fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let couplings = self.bundle.couplings(self.robust);
        let step = self.schur.step(&self.normal, &couplings, self.border.as_ref(), damping, FLOOR);
        drop(couplings);
        let first = !std::mem::replace(&mut self.has_asked, true);
        let step = step?;
        if first {
            self.bundle.right_offset.information = step.border_information;
            self.bundle.right_offset.pull = step.border_pull;
        }
        let offset = self.bundle.right_offset.value + step.border;
        let (poses, points) = self.bundle.moved(&self.slot, &step);
        let mut cost = self.bundle.cost(&poses, &points, offset, self.robust);
        cost += self.factors.attempt(&poses, &step.more);
        self.trial = (poses, points, offset);
        Some(Trial { cost, predicted_decrease: step.promise })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.bundle.poses, &mut self.trial.0);
        std::mem::swap(&mut self.bundle.points, &mut self.trial.1);
        self.bundle.right_offset.value = self.trial.2;
        self.factors.accept();
    }
}

/// A pixel with an offset added to its right x.
fn shifted(pixel: &Pixel, offset: f64) -> Pixel {
    [pixel[0], pixel[1], pixel[2] + offset]
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    /// Cameras on an arc around a cloud of points, stereo pixels without noise; the state is disturbed.
    fn disturbed() -> (Bundle, Vec<Se3>) {
        let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };
        let mut bundle = Bundle {
            camera,
            poses: vec![],
            freedom: vec![],
            points: vec![],
            observations: vec![],
            right_offset: RightOffset::default(),
        };
        let truth: Vec<Se3> = (0..6)
            .map(|i| {
                Se3::new(
                    So3::exp(&Vec3::new(0.0, 0.05 * i as f64, 0.0)),
                    Vec3::new(-0.3 * i as f64, 0.02, 0.0),
                )
            })
            .collect();
        for (i, pose) in truth.iter().enumerate() {
            let e = 0.01 * i as f64;
            bundle.poses.push(*pose * Se3::new(So3::exp(&Vec3::new(e, -e, 0.5 * e)), Vec3::new(e, e, -e)));
            bundle.freedom.push(if i == 0 { Freedom::Fixed } else { Freedom::Free });
        }
        bundle.poses[0] = truth[0];
        for j in 0..80u32 {
            let a = j as f64;
            let p = Vec3::new((a * 0.9).sin() * 2.0, (a * 1.7).cos(), 5.0 + (a * 0.31).sin());
            for (i, pose) in truth.iter().enumerate() {
                let q = pose.inverse() * p;
                let u = camera.fx * q.x / q.z + camera.cx;
                let right = if j % 2 == 0 { u - camera.baseline_fx / q.z } else { f64::NAN };
                let pixel = [u, camera.fy * q.y / q.z + camera.cy, right];
                bundle.observations.push(Observation { pose: i as u32, point: j, pixel, weight: 1.0 });
            }
            bundle.points.push(p + Vec3::new(0.03, -0.02, 0.05) * (a * 2.3).sin());
        }
        (bundle, truth)
    }

    #[test]
    fn recovers_the_true_poses() {
        let (mut bundle, truth) = disturbed();
        let config = BundleConfig { iterations: 20, tolerance: 1e-12, ..BundleConfig::default() };
        let report = bundle.solve(&config, || false);
        assert!(report.cost_after < 1e-8 * report.cost_before, "{report:?}");
        for (found, truth) in bundle.poses.iter().zip(&truth) {
            assert!(found.local(truth).norm() < 1e-5);
        }
    }

    #[test]
    fn disparity_prior_counts_and_information_is_the_curvature() {
        let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-5 };
        let off = |before: f64, sigma: f64| {
            let (mut bundle, truth) = disturbed();
            bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
            // Two cameras a known distance apart determine scale, against which damping is small.
            (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
            bundle.right_offset =
                RightOffset { value: before, prior: before, sigma, ..RightOffset::default() };
            bundle.solve(&config, || false);
            let cost = bundle.solve(&BundleConfig { iterations: 1, ..config }, || false).cost_after;
            (bundle.right_offset.value, bundle.right_offset.information, cost)
        };
        let (held, ..) = off(0.1, 1e-6);
        assert!((held - 0.1).abs() < 1e-3, "{held}");
        let (found, information, least) = off(0.1, 1e3);
        assert!((found - 0.3).abs() < 1e-3, "{found}");
        // Held off the best by d, all else free, it costs half the information times d squared.
        let d = 0.01;
        let (_, _, cost) = off(found + d, 0.0);
        let curvature = (cost - least) / (0.5 * d * d);
        assert!((information / curvature - 1.0).abs() < 0.05, "{information} against {curvature}");
    }

    #[test]
    fn disparity_error_is_estimated() {
        let (mut bundle, truth) = disturbed();
        for o in &mut bundle.observations {
            o.pixel[2] -= 0.3;
        }
        // Hardly a prior: the data alone decides.
        bundle.right_offset.sigma = 1000.0;
        let config = BundleConfig { iterations: 40, tolerance: 1e-14, ..BundleConfig::default() };
        let report = bundle.solve(&config, || false);
        assert!((bundle.right_offset.value - 0.3).abs() < 1e-3, "{:?} {report:?}", bundle.right_offset);
        assert!(bundle.poses.iter().zip(&truth).all(|(found, truth)| found.local(truth).norm() < 1e-3));
    }

    #[test]
    fn held_disparity_reports_its_pull_and_moves_nothing() {
        let config = BundleConfig { iterations: 40, robust: false, tolerance: 1e-14, first_damping: 1e-5 };
        let with = |sigma: f64, held: bool| {
            let (mut bundle, truth) = disturbed();
            bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
            (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
            (bundle.right_offset.sigma, bundle.right_offset.held) = (sigma, held);
            bundle.solve(&config, || false);
            // Once more from the solution: there the linear model gives the answer.
            bundle.solve(&config, || false);
            bundle
        };
        let (without, held, free) = (with(0.0, false), with(1e3, true), with(1e3, false));
        assert_eq!(held.right_offset.value, 0.0);
        assert!(held.poses.iter().zip(&without.poses).all(|(a, b)| a.local(b).norm() < 1e-9));
        assert!((held.right_offset.pull - 0.3).abs() < 0.01, "{}", held.right_offset.pull);
        assert!((held.right_offset.information / free.right_offset.information - 1.0).abs() < 0.1);
        assert!(free.right_offset.pull.abs() < 1e-4, "{}", free.right_offset.pull);
    }

    #[test]
    fn interrupt_keeps_the_best_state() {
        let (mut bundle, _) = disturbed();
        let mut calls = 0;
        let report = bundle.solve(&BundleConfig::default(), || {
            calls += 1;
            calls > 2
        });
        assert_eq!(report.stop, Stop::Interrupted);
        assert!(report.cost_after < report.cost_before);
    }

    #[test]
    fn point_behind_a_camera_is_left_out() {
        let (mut bundle, _) = disturbed();
        bundle.points[3] = Vec3::new(0.0, 0.0, -5.0);
        let report = bundle.solve(&BundleConfig::default(), || false);
        assert!(report.cost_after.is_finite() && report.cost_after < report.cost_before);
    }

    #[test]
    fn tilting_pose_keeps_position_and_heading() {
        let (mut bundle, truth) = disturbed();
        let up = Vec3::y();
        // All but the first are right, so that it alone has to move; a tilt is taken back, the rest of its error is not.
        bundle.poses = truth.clone();
        bundle.freedom = vec![Freedom::Fixed; truth.len()];
        let wrong = Se3::new(So3::exp(&Vec3::new(0.02, 0.03, -0.01)), Vec3::new(0.01, 0.0, 0.0));
        bundle.poses[0] = wrong * truth[0];
        bundle.freedom[0] = Freedom::Tilt(up);
        let before = bundle.poses[0];
        let config = BundleConfig { iterations: 30, robust: false, tolerance: 1e-12, first_damping: 1e-5 };
        let report = bundle.solve(&config, || false);
        let turned = (bundle.poses[0].rotation * before.rotation.inverse()).log();
        assert!(report.cost_after < report.cost_before && turned.norm() > 0.01, "{turned:?}");
        assert_eq!(bundle.poses[0].translation, before.translation);
        assert!(turned.dot(&up).abs() < 1e-3 * turned.norm(), "{turned:?}");
    }

    #[test]
    fn pose_covariance_is_the_inverse_of_the_curvature() {
        let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-9 };
        let (mut bundle, truth) = disturbed();
        (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
        bundle.solve(&config, || false);
        let covariance = bundle.pose_covariance(&mut NoFactors, 2, false).expect("a free pose");
        // Held off its best by d, everything else free, it costs half of d times the information times d.
        let d = SVector::<f64, 6>::from([0.002, -0.001, 0.003, 0.0005, -0.0004, 0.0003]);
        bundle.poses[2] = bundle.poses[2].retract(&d);
        bundle.freedom[2] = Freedom::Fixed;
        let cost = bundle.solve(&config, || false).cost_after;
        let expected = 0.5 * d.dot(&covariance.cholesky().expect("positive").solve(&d));
        assert!((cost / expected - 1.0).abs() < 0.05, "{cost} against {expected}");
        assert!(bundle.pose_covariance(&mut NoFactors, 0, false).is_none());
        assert!(bundle.pose_covariance(&mut NoFactors, 99, false).is_none());
    }
}
