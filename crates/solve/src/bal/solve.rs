//! Bundle adjustment of BAL problems.

use super::{Bal, BalCamera, BalObservation};
use crate::levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt, Problem, Trial};
use crate::schur::{More, Normal, Schur};
use crate::{CHI2_2, Loss, Report, Stop};
use cairn_geometry::{Manifold, Vec3};
use nalgebra::SMatrix;

/// Settings of [`Bal::solve`].
#[derive(Clone, Copy, Debug)]
pub struct BalConfig {
    /// Loss of a squared reprojection error in pixels.
    pub loss: Loss,
    /// Maximum number of steps, rejected ones included.
    pub iterations: usize,
    /// Converged when the linear model predicts to lower the cost by less than this part of it.
    pub tolerance: f64,
}

impl Default for BalConfig {
    fn default() -> Self {
        Self { loss: Loss::Squared, iterations: 100, tolerance: 1e-8 }
    }
}

impl Bal {
    /// Half the sum of the losses of squared reprojection errors.
    pub fn cost(&self, loss: Loss) -> f64 {
        cost(&self.cameras, &self.points, &self.observations, loss)
    }

    /// Lowers the cost by Levenberg-Marquardt; asks `stop` before each step. No variable is fixed:
    /// position, orientation and scale of the whole are free, and stay nearly as they were because steps are damped.
    pub fn solve(&mut self, config: &BalConfig, mut stop: impl FnMut() -> bool) -> Report {
        let before = self.cost(config.loss);
        let mut report = Report {
            iterations: 0,
            cost_before: before,
            cost_after: before,
            inliers: 0,
            stop: if self.observations.is_empty() { Stop::Empty } else { Stop::NoDescent },
        };
        if !self.observations.is_empty() && before.is_finite() {
            let solver = LevenbergMarquardt {
                iterations: config.iterations,
                damping: Damping::GainRatio { first: 1e-6, most: 1e10 },
                convergence: Convergence::Predicted {
                    relative: config.tolerance,
                    absolute: 1e-16 * self.observations.len() as f64,
                },
            };
            let mut adjustment = Adjustment::new(self, config.loss);
            let outcome = solver.minimise(&mut adjustment, &mut stop);
            (report.iterations, report.stop) = (outcome.iterations, outcome.stop);
            report.cost_after = outcome.cost_after;
            (self.cameras, self.points) = (adjustment.cameras, adjustment.points);
        }
        report.inliers =
            self.observations.iter().filter(|o| chi2(&self.cameras, &self.points, o) <= CHI2_2).count();
        report
    }
}

fn chi2(cameras: &[BalCamera], points: &[Vec3], o: &BalObservation) -> f64 {
    (cameras[o.camera as usize].project(&points[o.point as usize]) - o.pixel).norm_squared()
}

fn cost(cameras: &[BalCamera], points: &[Vec3], observations: &[BalObservation], loss: Loss) -> f64 {
    observations.iter().map(|o| 0.5 * loss.of(chi2(cameras, points, o)).0).sum()
}

/// A solve under way.
struct Adjustment {
    loss: Loss,
    /// By point.
    observations: Vec<BalObservation>,
    schur: Schur<9>,
    cameras: Vec<BalCamera>,
    points: Vec<Vec3>,
    tried: (Vec<BalCamera>, Vec<Vec3>),
    normal: Normal<9>,
    /// Of each observation: camera by point.
    couplings: Vec<SMatrix<f64, 9, 3>>,
}

impl Adjustment {
    fn new(bal: &Bal, loss: Loss) -> Self {
        let mut observations = bal.observations.clone();
        observations.sort_by_key(|o| o.point);
        let (cameras, points) = (bal.cameras.clone(), bal.points.clone());
        let seen = observations.iter().map(|o| (o.point as usize, Some(o.camera)));
        let schur = Schur::new(cameras.len(), points.len(), seen, More::default());
        let normal = schur.normal();
        let tried = (cameras.clone(), points.clone());
        let couplings = vec![SMatrix::zeros(); observations.len()];
        Self { loss, observations, schur, cameras, points, tried, normal, couplings }
    }

    fn build(&mut self) {
        let normal = &mut self.normal;
        normal.clear();
        for (o, coupling) in self.observations.iter().zip(&mut self.couplings) {
            let (camera, point) = (o.camera as usize, o.point as usize);
            let p = self.cameras[camera].linearise(&self.points[point]);
            let r = p.pixel - o.pixel;
            let (loss, weight) = self.loss.of(r.norm_squared());
            normal.cost += 0.5 * loss;
            let weighted = p.by_camera * weight;
            normal.cameras[camera] += p.by_camera.tr_mul(&weighted);
            normal.camera_gradients[camera] += weighted.tr_mul(&r);
            normal.points[point] += p.by_point.tr_mul(&p.by_point) * weight;
            normal.point_gradients[point] += p.by_point.tr_mul(&r) * weight;
            *coupling = weighted.tr_mul(&p.by_point);
        }
    }
}

impl Problem for Adjustment {
    async fn linearise(&mut self) -> Option<f64> {
        self.build();
        Some(self.normal.cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let step = self.schur.step(&self.normal, &|k| self.couplings[k], &[], damping, 1e-12).await?;
        let (cameras, points) = &mut self.tried;
        for ((to, from), d) in cameras.iter_mut().zip(&self.cameras).zip(&step.cameras) {
            *to = from.retract(d);
        }
        for ((to, from), d) in points.iter_mut().zip(&self.points).zip(&step.points) {
            *to = from + d;
        }
        let cost = cost(cameras, points, &self.observations, self.loss);
        Some(Trial { cost, predicted_decrease: step.promise })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.cameras, &mut self.tried.0);
        std::mem::swap(&mut self.points, &mut self.tried.1);
    }
}
