//! By how much a pose graph's state may miss the global optimum.
//!
//! Of SE-Sync's objective `sum kappa |R_b - R_a R_ab|^2 + tau |t_b - t_a - R_a t_ab|^2`, the minimum over all rotations is at least
//! `tr(Lambda) - eta d n` for any block diagonal `Lambda` with `M - Lambda + eta I >= 0`, where `M` is the matrix of the quadratic form
//! and `I` is over the columns of rotations. At a stationary point `Lambda = sym(R^T (X M))` makes the bound tight where the
//! relaxation is. Source: Rosen, Carlone, Bandeira, Leonard, "SE-Sync: a certifiably correct algorithm for synchronization over
//! the special Euclidean group" (2019), theorem 7 and equation 107. Instead of the least eigenvalue, the smallest `eta` of a
//! sequence is taken for which a sparse Cholesky factorisation succeeds. The plane is looked at as part of space.

use super::{PoseGraph, Rigid};
use crate::sparse::{Analysis, Factor, UniformBlocks};
use cairn_geometry::{Mat3, Vec3};
use nalgebra::{Matrix4, Vector4};
use std::sync::Arc;

/// Bounds of SE-Sync's objective.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Certificate {
    /// The objective where the graph is.
    pub objective: f64,
    /// No state has a lower one than this; not above the objective but for rounding.
    pub lower_bound: f64,
}

impl Certificate {
    /// How far the objective may be above the global optimum, as a part of it; infinite where the bound says nothing.
    pub fn gap(&self) -> f64 {
        match self.lower_bound > 0.0 {
            true => (self.objective / self.lower_bound - 1.0).max(0.0),
            false => f64::INFINITY,
        }
    }
}

/// `eta` is tried from this part of the objective on, divided by `d n`, and ten times as large each time.
const FIRST: f64 = 1e-8;
const TRIALS: i32 = 12;

/// Bounds SE-Sync's objective at the graph's values, with the weights of [`Rigid::weights`]; robust losses play no part. `None`
/// when a number is not finite, or no bound was found. Minimise with [`Rigid::isotropic`] information and
/// [`super::Metric::Chordal`] first: away from a stationary point the bound is loose.
pub fn certify<G: Rigid<D>, const D: usize>(graph: &PoseGraph<G, D>) -> Option<Certificate> {
    let n = graph.values().len();
    let poses: Vec<(Mat3, Vec3)> = graph.values().iter().map(|v| v.to_space()).collect();
    let analysis = Arc::new(Analysis::new(n, 4, graph.edges().iter().map(|e| (e.a, e.b))));
    let mut form = Form {
        diagonal: vec![Matrix4::zeros(); n],
        off: vec![Matrix4::zeros(); analysis.pairs().len()],
        gradient: vec![nalgebra::Matrix3x4::zeros(); n],
        objective: 0.0,
    };
    for e in graph.edges() {
        form.add(&analysis, (e.a, e.b), &poses, e.a_from_b.to_space(), G::weights(&e.information));
    }
    // The position of one pose of each component is free: holding it changes no minimum.
    let weight = form.diagonal.iter().map(|m| m[(3, 3)]).fold(1.0, f64::max);
    for (m, _) in form.diagonal.iter_mut().zip(graph.held()).filter(|(_, held)| *held) {
        m[(3, 3)] += weight;
    }
    let mut trace = 0.0;
    for ((block, gradient), (rotation, _)) in form.diagonal.iter_mut().zip(&form.gradient).zip(&poses) {
        let lambda = rotation.transpose() * gradient.fixed_columns::<3>(0);
        let lambda = (lambda + lambda.transpose()) * 0.5;
        trace += lambda.trace();
        let mut rotations = block.fixed_view_mut::<3, 3>(0, 0);
        rotations -= lambda;
    }
    if !form.objective.is_finite() || !trace.is_finite() {
        return None;
    }
    let mut factor = Factor::new(analysis);
    let off: Vec<f64> = form.off.iter().flat_map(|m| m.iter().copied()).collect();
    let unknowns = 3.0 * n as f64;
    let smallest = FIRST * form.objective.max(1e-12) / unknowns;
    (0..TRIALS).map(|k| smallest * 10f64.powi(k)).find_map(|eta| {
        let lifted = Matrix4::from_diagonal(&Vector4::new(eta, eta, eta, 0.0));
        let diagonal: Vec<f64> = form.diagonal.iter().flat_map(|m| (m + lifted).data.0).flatten().collect();
        let blocks = UniformBlocks { size: 4, diagonal: &diagonal, off_diagonal: &off };
        factor.factor(&blocks).ok()?;
        Some(Certificate { objective: form.objective, lower_bound: trace - eta * unknowns })
    })
}

/// The quadratic form `tr(X M X^T)` of the poses `X = [R_1 t_1 R_2 t_2 ...]`.
struct Form {
    diagonal: Vec<Matrix4<f64>>,
    /// In the order of the pairs, rows of the greater vertex.
    off: Vec<Matrix4<f64>>,
    /// `X M`.
    gradient: Vec<nalgebra::Matrix3x4<f64>>,
    objective: f64,
}

impl Form {
    fn add(
        &mut self,
        analysis: &Analysis,
        (a, b): (usize, usize),
        poses: &[(Mat3, Vec3)],
        (rotation, translation): (Mat3, Vec3),
        (tau, kappa): (f64, f64),
    ) {
        // The residuals are X_b - X_a T, with weights kappa for the columns of rotation and tau for that of translation.
        let mut t = Matrix4::identity();
        t.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        t.fixed_view_mut::<3, 1>(0, 3).copy_from(&translation);
        let weights = Matrix4::from_diagonal(&Vector4::new(kappa, kappa, kappa, tau));
        let weighted = t * weights;
        self.diagonal[b] += weights;
        self.diagonal[a] += weighted * t.transpose();
        if let Some(pair) = analysis.pair(a, b) {
            self.off[pair] -= if a > b { weighted } else { weighted.transpose() };
        }
        let x = |k: usize| {
            let (r, t) = &poses[k];
            nalgebra::Matrix3x4::from_columns(&[
                r.column(0).into(),
                r.column(1).into(),
                r.column(2).into(),
                *t,
            ])
        };
        let residual = x(b) - x(a) * t;
        let pull = residual * weights;
        self.gradient[b] += pull;
        self.gradient[a] -= pull * t.transpose();
        self.objective += residual.component_mul(&pull).sum();
    }
}
