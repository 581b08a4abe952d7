//! Smoothing: all poses and landmarks of a log at once, by robust nonlinear least squares on a sparse Cholesky.
//!
//! The cost is half the sum of squared whitened odometry residuals and of the robust losses of squared whitened
//! sightings (Dellaert and Kaess, "Square root SAM", IJRR 2006), minimised by Levenberg-Marquardt (Madsen, Nielsen,
//! Tingleff 2004, 3.2). The first pose of the first robot is fixed. Blocks of landmarks are padded to three, so that
//! all blocks have one size.

use crate::angle::wrap;
use crate::log::{Step, Target};
use crate::measure::{Measurement, jacobians};
use cairn_geometry::Vec2;
use cairn_solve::sparse::{Analysis, Factor, UniformBlocks};
use cairn_solve::{Convergence, Damping, LevenbergMarquardt, Loss, Problem, Stop, Trial};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Smaller variances (m^2, rad^2) are raised to this one: the odometry of a robot that stands still has no noise at
/// all.
const LEAST_VARIANCE: f64 = 1e-10;

/// Configuration of the smoother.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchConfig {
    /// Robust loss of a whitened sighting.
    pub loss: Loss,
    /// Greatest number of steps.
    pub iterations: usize,
    /// Converged when the linear model promises to lower the cost by less than this fraction of it.
    pub tolerance: f64,
}

impl Default for BatchConfig {
    fn default() -> Self {
        Self { loss: Loss::Cauchy(1.6), iterations: 50, tolerance: 1e-7 }
    }
}

/// A smoothed run, or the initial guess of one.
#[derive(Clone, Debug, PartialEq)]
pub struct Smoothed {
    /// Poses (x m, y m, angle rad) of each robot at its steps.
    pub poses: Vec<Vec<Vector3<f64>>>,
    /// Landmarks by label, in metres.
    pub landmarks: BTreeMap<u32, Vec2>,
}

/// How the optimisation went.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatchReport {
    /// Steps tried.
    pub iterations: usize,
    /// Cost of the initial guess.
    pub cost_before: f64,
    /// Cost of the result.
    pub cost_after: f64,
    /// Whether the cost stopped falling before the iterations ran out.
    pub converged: bool,
    /// Sightings used: those of targets that the initial guess contains.
    pub sightings: usize,
}

/// Minimises the cost from `start`, which has one pose for each step of each robot; landmarks missing from it are left
/// out. Another robot counts as a target only where it has a step at the instant of the sighting.
///
/// Returns the best state found, for whatever reason the iterations ended.
pub fn smooth(steps: &[Vec<Step>], start: Smoothed, config: &BatchConfig) -> (Smoothed, BatchReport) {
    let graph = Graph::new(steps, &start);
    let mut descent = Descent::new(&graph, graph.pack(&start), config.loss);
    let cost = descent.normal.cost;
    let mut report = BatchReport {
        iterations: 0,
        cost_before: cost,
        cost_after: cost,
        converged: false,
        sightings: graph.sightings.len(),
    };
    if cost.is_finite() {
        let solver = LevenbergMarquardt {
            iterations: config.iterations,
            damping: Damping::GainRatio { first: 1e-6, most: 1e10 },
            convergence: Convergence::Predicted { relative: config.tolerance, absolute: 0.0 },
        };
        let outcome = solver.minimise(&mut descent, || false);
        (report.iterations, report.cost_after) = (outcome.iterations, outcome.cost_after);
        report.converged = outcome.stop == Stop::Converged;
    }
    (graph.unpack(&start, &descent.now), report)
}

struct Odometry {
    from: usize,
    to: usize,
    measured: Vector3<f64>,
    information: Matrix3<f64>,
}

struct Seen {
    observer: usize,
    target: usize,
    measurement: Measurement,
    information: Matrix3<f64>,
}

/// Numbering of the variables: poses robot by robot, then landmarks by label.
struct Graph {
    first_of: Vec<usize>,
    landmarks: Vec<u32>,
    count: usize,
    odometry: Vec<Odometry>,
    sightings: Vec<Seen>,
}

impl Graph {
    fn new(steps: &[Vec<Step>], start: &Smoothed) -> Self {
        let mut first_of = Vec::new();
        let mut poses = 0;
        for robot in steps {
            first_of.push(poses);
            poses += robot.len();
        }
        let landmarks: Vec<u32> = start.landmarks.keys().copied().collect();
        let count = poses + landmarks.len();
        let mut graph = Self { first_of, landmarks, count, odometry: Vec::new(), sightings: Vec::new() };
        for (robot, robot_steps) in steps.iter().enumerate() {
            for (k, step) in robot_steps.iter().enumerate() {
                let at = graph.first_of[robot] + k;
                if k > 0 {
                    graph.add_odometry(at, step);
                }
                for sighting in &step.sightings {
                    let target = graph.target(steps, sighting.target, step.time_s, poses);
                    if let Some(target) = target {
                        graph.add_sighting(at, target, sighting.measurement);
                    }
                }
            }
        }
        graph
    }

    fn target(&self, steps: &[Vec<Step>], target: Target, time_s: f64, poses: usize) -> Option<usize> {
        match target {
            Target::Landmark(label) => Some(poses + self.landmarks.binary_search(&label).ok()?),
            Target::Robot(other) => {
                let steps = steps.get(other)?;
                let k = steps.binary_search_by(|s| s.time_s.total_cmp(&time_s)).ok()?;
                Some(self.first_of[other] + k)
            }
            Target::Unlabelled => None,
        }
    }

    fn add_odometry(&mut self, to: usize, step: &Step) {
        let t = &step.motion.before_from_after;
        let measured = Vector3::new(t.translation.x, t.translation.y, t.rotation.log());
        let covariance = step.motion.covariance + Matrix3::identity() * LEAST_VARIANCE;
        if let Some(cholesky) = covariance.cholesky() {
            self.odometry.push(Odometry { from: to - 1, to, measured, information: cholesky.inverse() });
        }
    }

    fn add_sighting(&mut self, observer: usize, target: usize, measurement: Measurement) {
        let rows = measurement.kind().rows();
        let Some(inverse) = measurement.covariance().fixed_view::<3, 3>(0, 0).into_owned().cholesky() else {
            return;
        };
        let inverse = inverse.inverse();
        let information = Matrix3::from_fn(|i, j| if i < rows && j < rows { inverse[(i, j)] } else { 0.0 });
        self.sightings.push(Seen { observer, target, measurement, information });
    }

    fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        let odometry = self.odometry.iter().map(|o| (o.from, o.to));
        odometry.chain(self.sightings.iter().map(|s| (s.observer, s.target)))
    }

    fn pack(&self, start: &Smoothed) -> Vec<Vector3<f64>> {
        let poses = start.poses.iter().flatten().copied();
        poses.chain(start.landmarks.values().map(|p| p.push(0.0))).collect()
    }

    fn unpack(&self, start: &Smoothed, values: &[Vector3<f64>]) -> Smoothed {
        let mut rest = values.iter().copied();
        let pose = |mut v: Vector3<f64>| {
            v.z = wrap(v.z);
            v
        };
        let poses = start.poses.iter().map(|r| rest.by_ref().take(r.len()).map(pose).collect()).collect();
        Smoothed { poses, landmarks: self.landmarks.iter().copied().zip(rest.map(|v| v.xy())).collect() }
    }
}

/// Normal equations with a fixed block sparsity pattern.
#[derive(Clone)]
struct Normal {
    diagonal: Vec<Matrix3<f64>>,
    off_diagonal: Vec<Matrix3<f64>>,
    gradient: Vec<Vector3<f64>>,
    cost: f64,
}

impl Normal {
    fn fill(&mut self, graph: &Graph, analysis: &Analysis, values: &[Vector3<f64>], loss: Loss) {
        self.diagonal.fill(Matrix3::zeros());
        self.off_diagonal.fill(Matrix3::zeros());
        self.gradient.fill(Vector3::zeros());
        self.cost = 0.0;
        for o in &graph.odometry {
            let (residual, by_from, by_to) = odometry_residual(&values[o.from], &values[o.to], &o.measured);
            self.add(
                analysis,
                [(o.from, &by_from), (o.to, &by_to)],
                &residual,
                &o.information,
                Loss::Squared,
            );
        }
        for s in &graph.sightings {
            let (observer, target) = (&values[s.observer], &values[s.target]);
            let Some((by_observer, by_target)) = jacobians(s.measurement.kind(), observer, target) else {
                continue;
            };
            // The innovation is measured minus expected; the residual has the opposite sign.
            let residual = -s.measurement.innovation(observer, target);
            self.add(
                analysis,
                [(s.observer, &by_observer), (s.target, &by_target)],
                &residual,
                &s.information,
                loss,
            );
        }
        // The first pose is fixed; the padding of landmark blocks has no information.
        self.diagonal[0] += Matrix3::identity() * 1e12;
        for block in &mut self.diagonal {
            (0..3)
                .filter(|k| block[(*k, *k)] == 0.0)
                .collect::<Vec<_>>()
                .into_iter()
                .for_each(|k| block[(k, k)] = 1.0);
        }
    }

    fn add(
        &mut self,
        analysis: &Analysis,
        [(a, by_a), (b, by_b)]: [(usize, &Matrix3<f64>); 2],
        residual: &Vector3<f64>,
        information: &Matrix3<f64>,
        loss: Loss,
    ) {
        let weighted = information * residual;
        let (cost, weight) = loss.of(residual.dot(&weighted));
        self.cost += 0.5 * cost;
        let (wa, wb) = (information * by_a * weight, information * by_b * weight);
        self.diagonal[a] += by_a.tr_mul(&wa);
        self.diagonal[b] += by_b.tr_mul(&wb);
        self.gradient[a] += by_a.tr_mul(&weighted) * weight;
        self.gradient[b] += by_b.tr_mul(&weighted) * weight;
        if let Some(pair) = analysis.pair(a, b) {
            // The row index must be greater than the column index.
            self.off_diagonal[pair] += if a > b { by_a.tr_mul(&wb) } else { by_b.tr_mul(&wa) };
        }
    }
}

/// A solve under way.
struct Descent<'a> {
    graph: &'a Graph,
    loss: Loss,
    analysis: Arc<Analysis>,
    factor: Factor,
    now: Vec<Vector3<f64>>,
    /// The system at `now`.
    normal: Normal,
    next: Vec<Vector3<f64>>,
    /// The system at `next`, the state tried.
    tried: Normal,
}

impl<'a> Descent<'a> {
    fn new(graph: &'a Graph, now: Vec<Vector3<f64>>, loss: Loss) -> Self {
        let analysis = Arc::new(Analysis::new(graph.count, 3, graph.pairs()));
        let mut normal = Normal {
            diagonal: vec![Matrix3::zeros(); graph.count],
            off_diagonal: vec![Matrix3::zeros(); analysis.pairs().len()],
            gradient: vec![Vector3::zeros(); graph.count],
            cost: 0.0,
        };
        normal.fill(graph, &analysis, &now, loss);
        let factor = Factor::new(Arc::clone(&analysis));
        Self { graph, loss, analysis, factor, next: now.clone(), now, tried: normal.clone(), normal }
    }

    /// The damped step, and the decrease of the cost predicted by the linear model; `None` when the system is singular.
    fn step(&mut self, lambda: f64) -> Option<(Vec<Vector3<f64>>, f64)> {
        let damp = |m: &Matrix3<f64>| m + Matrix3::from_diagonal(&m.diagonal()) * lambda;
        let diagonal: Vec<f64> = self.normal.diagonal.iter().flat_map(|m| damp(m).data.0).flatten().collect();
        let off_diagonal: Vec<f64> =
            self.normal.off_diagonal.iter().flat_map(|m| m.data.0).flatten().collect();
        let blocks = UniformBlocks { size: 3, diagonal: &diagonal, off_diagonal: &off_diagonal };
        self.factor.factor(&blocks).ok()?;
        let mut step: Vec<f64> = self.normal.gradient.iter().flat_map(|g| g.data.0[0]).map(|v| -v).collect();
        self.factor.solve(&mut step);
        let step: Vec<Vector3<f64>> = step.chunks_exact(3).map(Vector3::from_column_slice).collect();
        let promise = step.iter().zip(&self.normal.gradient).zip(&self.normal.diagonal);
        let promise = promise
            .map(|((s, g), h)| 0.5 * s.dot(&(lambda * h.diagonal().component_mul(s) - g)))
            .sum::<f64>();
        promise.is_finite().then_some((step, promise))
    }
}

impl Problem for Descent<'_> {
    async fn linearise(&mut self) -> Option<f64> {
        // A trial state is linearised as it is evaluated.
        Some(self.normal.cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let (step, predicted_decrease) = self.step(damping)?;
        self.next = self.now.iter().zip(&step).map(|(v, s)| v + s).collect();
        self.tried.fill(self.graph, &self.analysis, &self.next, self.loss);
        Some(Trial { cost: self.tried.cost, predicted_decrease })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.now, &mut self.next);
        std::mem::swap(&mut self.normal, &mut self.tried);
    }
}

/// Expected minus measured motion, in the frame before the motion, and its derivatives with respect to the two poses.
fn odometry_residual(
    from: &Vector3<f64>,
    to: &Vector3<f64>,
    measured: &Vector3<f64>,
) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
    let (s, c) = from.z.sin_cos();
    let d = to - from;
    let local = Vector3::new(c * d.x + s * d.y, c * d.y - s * d.x, 0.0);
    let residual = Vector3::new(local.x - measured.x, local.y - measured.y, wrap(d.z - measured.z));
    let by_from = Matrix3::new(-c, -s, local.y, s, -c, -local.x, 0.0, 0.0, -1.0);
    let by_to = Matrix3::new(c, s, 0.0, -s, c, 0.0, 0.0, 0.0, 1.0);
    (residual, by_from, by_to)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odometry_has_the_derivative_of_differences() {
        let (from, to) = (Vector3::new(1.0, 2.0, 3.0), Vector3::new(0.5, 2.7, -2.9));
        let measured = Vector3::new(0.3, 0.1, 0.2);
        let (_, by_from, by_to) = odometry_residual(&from, &to, &measured);
        let h = 1e-6;
        for k in 0..3 {
            let step = Vector3::from_fn(|i, _| if i == k { h } else { 0.0 });
            let at = |from, to| odometry_residual(&from, &to, &measured).0;
            let a = (at(from + step, to) - at(from - step, to)) / (2.0 * h);
            let b = (at(from, to + step) - at(from, to - step)) / (2.0 * h);
            assert!((by_from.column(k) - a).norm() < 1e-7 && (by_to.column(k) - b).norm() < 1e-7);
        }
    }
}
