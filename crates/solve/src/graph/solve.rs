//! Solving a graph.

use super::normal::{Layout, Normal};
use super::{GraphConfig, Method, Metric, PoseGraph};
use crate::levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt, Problem, Trial};
use crate::sparse::{Factor, NotPositive, UniformBlocks};
use crate::{CHI2_95, Report, Stop};
use cairn_geometry::LieGroup;
use nalgebra::{DMatrix, SVector};
use std::sync::Arc;

impl<G: LieGroup<D>, const D: usize> PoseGraph<G, D> {
    /// The gradient of the cost by the tangent of each vertex; zero for those that are held while solving.
    pub fn gradient(&self, metric: Metric) -> Vec<SVector<f64, D>> {
        let layout = Layout::new(&self.held(), self);
        let mut normal = Normal::new(&layout);
        normal.fill(&layout, &self.values, self, metric);
        let of =
            |slot: &Option<u32>| slot.map_or_else(SVector::zeros, |k| normal.gradient[k as usize].into());
        layout.slot.iter().map(of).collect()
    }

    /// The joint covariance of these vertices at the current values, `D` rows for each: of right perturbations, given the
    /// vertices that are held while solving (their rows are zero).
    ///
    /// # Errors
    /// When the edges do not determine every pose.
    ///
    /// # Panics
    /// When a vertex does not exist.
    pub fn covariance(&self, of: &[usize], metric: Metric) -> Result<DMatrix<f64>, NotPositive> {
        let mut layout = Layout::new(&self.held(), self);
        let mut normal = Normal::new(&layout);
        normal.fill(&layout, &self.values, self, metric);
        let empty = crate::sparse::Analysis::new(0, D, std::iter::empty());
        let mut factor = Factor::new(Arc::new(std::mem::replace(&mut layout.analysis, empty)));
        factor.factor(&UniformBlocks {
            size: D,
            diagonal: normal.diagonal.as_flattened().as_flattened(),
            off_diagonal: normal.off_diagonal.as_flattened().as_flattened(),
        })?;
        let place = |v: usize| layout.slot[v].map(|k| k as usize * D);
        let mut covariance = DMatrix::zeros(of.len() * D, of.len() * D);
        let mut x = vec![0.0; factor.analysis().dimension()];
        for (k, first) in of.iter().enumerate().filter_map(|(k, v)| Some((k, place(*v)?))) {
            for d in 0..D {
                x.fill(0.0);
                x[first + d] = 1.0;
                factor.solve(&mut x);
                for (l, row) in of.iter().enumerate().filter_map(|(l, v)| Some((l, place(*v)?))) {
                    covariance.column_mut(k * D + d).rows_mut(l * D, D).copy_from_slice(&x[row..row + D]);
                }
            }
        }
        Ok(covariance)
    }

    /// Lowers the cost; asks `stop` before each step. Whatever the reason to stop, the vertices are left in the best state found.
    pub fn solve(&mut self, config: &GraphConfig, mut stop: impl FnMut() -> bool) -> Report {
        let layout = Layout::new(&self.held(), self);
        let cost = self.cost(config.metric);
        let mut report = Report {
            iterations: 0,
            cost_before: cost,
            cost_after: cost,
            inliers: 0,
            stop: if (self.edges.is_empty() && self.condensed.is_empty()) || layout.analysis.rows() == 0 {
                Stop::Empty
            } else if cost.is_finite() {
                Stop::Iterations
            } else {
                Stop::NoDescent
            },
        };
        if report.stop == Stop::Iterations {
            let mut descent = Descent::new(self, layout, config);
            let solver = LevenbergMarquardt {
                iterations: config.iterations,
                damping: match config.method {
                    Method::GaussNewton => Damping::GaussNewton,
                    Method::LevenbergMarquardt => Damping::GainRatio { first: 1e-6, most: 1e10 },
                },
                convergence: Convergence::Predicted {
                    relative: config.tolerance,
                    absolute: 1e-16 * (self.edges.len() + self.condensed.len()) as f64,
                },
            };
            let outcome = solver.minimise(&mut descent, &mut stop);
            (report.iterations, report.stop) = (outcome.iterations, outcome.stop);
            report.cost_after = descent.best_cost;
            self.values = descent.best;
        }
        let bound = D.checked_sub(1).and_then(|k| CHI2_95.get(k)).copied().unwrap_or(f64::INFINITY);
        report.inliers = self.edges.iter().filter(|e| self.chi2(e, config.metric) <= bound).count();
        report
    }
}

/// A solve under way.
struct Descent<'a, G, const D: usize> {
    graph: &'a PoseGraph<G, D>,
    config: &'a GraphConfig,
    layout: Layout,
    factor: Factor,
    /// The system at `now`.
    normal: Normal<D>,
    now: Vec<G>,
    /// The system at the state tried, and that state.
    tried: Normal<D>,
    next: Vec<G>,
    best: Vec<G>,
    best_cost: f64,
}

impl<'a, G: LieGroup<D>, const D: usize> Descent<'a, G, D> {
    fn new(graph: &'a PoseGraph<G, D>, mut layout: Layout, config: &'a GraphConfig) -> Self {
        let mut normal = Normal::new(&layout);
        normal.fill(&layout, &graph.values, graph, config.metric);
        let empty = crate::sparse::Analysis::new(0, D, std::iter::empty());
        let analysis = Arc::new(std::mem::replace(&mut layout.analysis, empty));
        Self {
            factor: Factor::new(analysis),
            best_cost: normal.cost,
            tried: normal.clone(),
            now: graph.values.clone(),
            next: graph.values.clone(),
            best: graph.values.clone(),
            graph,
            config,
            layout,
            normal,
        }
    }

    /// The step from `now`, and by how much the linear model lowers the cost; `None` when the system is singular.
    fn step(&mut self, lambda: f64) -> Option<(Vec<[f64; D]>, f64)> {
        let damped;
        let diagonal = if lambda > 0.0 {
            damped = self.normal.damped(lambda);
            &damped
        } else {
            &self.normal.diagonal
        };
        let blocks = UniformBlocks {
            size: D,
            diagonal: diagonal.as_flattened().as_flattened(),
            off_diagonal: self.normal.off_diagonal.as_flattened().as_flattened(),
        };
        self.factor.factor(&blocks).ok()?;
        let mut step: Vec<[f64; D]> = self.normal.gradient.iter().map(|g| g.map(|v| -v)).collect();
        self.factor.solve(step.as_flattened_mut());
        let mut promise = 0.0;
        for ((s, g), h) in step.iter().zip(&self.normal.gradient).zip(&self.normal.diagonal) {
            for k in 0..D {
                promise += 0.5 * s[k] * (lambda * h[k][k].max(1e-12) * s[k] - g[k]);
            }
        }
        promise.is_finite().then_some((step, promise))
    }

    /// Moves `next` there and linearises.
    fn try_step(&mut self, step: &[[f64; D]]) {
        for ((next, now), slot) in self.next.iter_mut().zip(&self.now).zip(&self.layout.slot) {
            if let Some(k) = slot {
                *next = now.retract(&SVector::from(step[*k as usize]));
            }
        }
        self.tried.fill(&self.layout, &self.next, self.graph, self.config.metric);
        if !self.next.iter().all(|v| v.is_finite()) {
            self.tried.cost = f64::INFINITY;
        }
    }
}

impl<G: LieGroup<D>, const D: usize> Problem for Descent<'_, G, D> {
    async fn linearise(&mut self) -> Option<f64> {
        // A trial state is linearised as it is evaluated.
        Some(self.normal.cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let (step, predicted_decrease) = self.step(damping)?;
        self.try_step(&step);
        Some(Trial { cost: self.tried.cost, predicted_decrease })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.now, &mut self.next);
        std::mem::swap(&mut self.normal, &mut self.tried);
        if self.normal.cost <= self.best_cost {
            self.best_cost = self.normal.cost;
            self.best.copy_from_slice(&self.now);
        }
    }
}
