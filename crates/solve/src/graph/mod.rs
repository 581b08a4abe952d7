//! Graphs of poses: vertices are poses `world_from_vertex`, edges measured transforms `a_from_b` between two of them.
//!
//! One code for every group that keeps [`LieGroup`]: the plane (`Se2`), space (`Se3`), space with unknown scale (`Sim3`),
//! and space with known gravity (`YawPose`). What is minimised is half the sum of the losses of `r^T information r`,
//! where `r` are the coordinates of `measured^-1 * (a^-1 * b)` (Grisetti et al., "A tutorial on graph-based SLAM",
//! 2010; Dellaert and Kaess, "Factor graphs for robot perception", 2017, chapter 6).

mod certify;
mod chordal;
mod condense;
mod condensed;
mod normal;
mod odometry;
mod solve;
mod start;

pub use certify::{Certificate, certify};
pub use chordal::{Rigid, chordal_start};
pub use condense::CondenseError;
pub use condensed::{Condensed, CondensedError};
pub use odometry::odometry_start;
pub use start::{Start, StartCost, lowest_start};

use crate::Loss;
use cairn_geometry::LieGroup;
use nalgebra::{Cholesky, SMatrix, SVector};

/// How steps are computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// The full step each time, also where it raises the cost; the best state is kept. Few steps from a good start.
    GaussNewton,
    /// Damped steps, none of which raises the cost (Levenberg-Marquardt, damping after Nielsen 1999).
    LevenbergMarquardt,
}

/// What the residual of an edge is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Metric {
    /// The coordinates of the group ([`LieGroup::coordinates`]).
    Geodesic,
    /// The translation and `2 sin(angle / 2)` along the axis ([`LieGroup::chordal`]).
    Chordal,
}

/// Settings of [`PoseGraph::solve`].
#[derive(Clone, Copy, Debug)]
pub struct GraphConfig {
    /// How steps are computed.
    pub method: Method,
    /// What the residual of an edge is.
    pub metric: Metric,
    /// Maximum number of steps, rejected ones included.
    pub iterations: usize,
    /// Converged when the linear model predicts to lower the cost by less than this part of it.
    pub tolerance: f64,
}

impl Default for GraphConfig {
    fn default() -> Self {
        Self {
            method: Method::LevenbergMarquardt,
            metric: Metric::Geodesic,
            iterations: 100,
            tolerance: 1e-9,
        }
    }
}

/// A measured transform between two vertices.
#[derive(Clone, Copy, Debug)]
pub struct Edge<G, const D: usize> {
    /// Index of the first vertex.
    pub a: usize,
    /// Index of the second vertex.
    pub b: usize,
    /// The measurement.
    pub a_from_b: G,
    /// Inverse covariance of the measurement's coordinates.
    pub information: SMatrix<f64, D, D>,
    /// Robust loss of its residual.
    pub loss: Loss,
}

impl<G, const D: usize> Edge<G, D> {
    /// Whether nothing is said of the rotation: what a point that was seen, or a position, is known by. Its residual is the
    /// translation itself, whatever the metric.
    fn is_position(&self) -> bool {
        self.information[(D - 1, D - 1)] == 0.0
    }

    fn metric(&self, metric: Metric) -> Metric {
        if self.is_position() { Metric::Chordal } else { metric }
    }
}

/// Why an edge was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EdgeError {
    /// It names a vertex that does not exist.
    #[error("vertex {0} does not exist")]
    NoVertex(usize),
    /// Both its ends are the same vertex.
    #[error("it connects vertex {0} to itself")]
    Loop(usize),
    /// The measurement is not finite.
    #[error("its measurement is not finite")]
    Measurement,
    /// The information matrix is not finite, symmetric and positive semi-definite.
    #[error("its information matrix is not symmetric and positive semi-definite")]
    Information,
    /// The width of the loss is not positive and finite.
    #[error("the width of its robust loss is not positive")]
    Width,
}

/// A graph of poses.
///
/// Components of the graph without a fixed vertex are held at their first vertex while solving.
#[derive(Clone, Debug, Default)]
pub struct PoseGraph<G, const D: usize> {
    values: Vec<G>,
    fixed: Vec<bool>,
    edges: Vec<Edge<G, D>>,
    condensed: Vec<Condensed<G, D>>,
}

impl<G: LieGroup<D>, const D: usize> PoseGraph<G, D> {
    /// A graph without vertices.
    pub fn new() -> Self {
        Self { values: Vec::new(), fixed: Vec::new(), edges: Vec::new(), condensed: Vec::new() }
    }

    /// Adds a vertex with its `world_from_vertex`; `fixed` ones are not moved. Returns its index.
    pub fn add_vertex(&mut self, world_from_vertex: G, fixed: bool) -> usize {
        self.values.push(world_from_vertex);
        self.fixed.push(fixed);
        self.values.len() - 1
    }

    /// Adds an edge: `a_from_b` as measured, and the inverse covariance of its coordinates. Returns its index.
    ///
    /// # Errors
    /// When a vertex does not exist, both are the same, or measurement, information or loss are invalid.
    pub fn add_edge(
        &mut self,
        a: usize,
        b: usize,
        a_from_b: G,
        information: &SMatrix<f64, D, D>,
        loss: Loss,
    ) -> Result<usize, EdgeError> {
        for vertex in [a, b] {
            if vertex >= self.values.len() {
                return Err(EdgeError::NoVertex(vertex));
            }
        }
        if a == b {
            return Err(EdgeError::Loop(a));
        }
        if !a_from_b.is_finite() {
            return Err(EdgeError::Measurement);
        }
        if let Loss::Huber(width) | Loss::Cauchy(width) = loss
            && !(width.is_finite() && width > 0.0)
        {
            return Err(EdgeError::Width);
        }
        if !semi_definite(information) {
            return Err(EdgeError::Information);
        }
        self.edges.push(Edge { a, b, a_from_b, information: *information, loss });
        Ok(self.edges.len() - 1)
    }

    /// `world_from_vertex` of all vertices.
    pub fn values(&self) -> &[G] {
        &self.values
    }

    /// The same, mutable.
    pub fn values_mut(&mut self) -> &mut [G] {
        &mut self.values
    }

    /// Which vertices are fixed.
    pub fn fixed(&self) -> &[bool] {
        &self.fixed
    }

    /// All edges.
    pub fn edges(&self) -> &[Edge<G, D>] {
        &self.edges
    }

    /// The edges, mutable; indices must stay within the graph.
    pub fn edges_mut(&mut self) -> &mut [Edge<G, D>] {
        &mut self.edges
    }

    /// Squared whitened residual of an edge.
    pub fn chi2(&self, edge: &Edge<G, D>, metric: Metric) -> f64 {
        let r = residual(&self.error(edge), edge.metric(metric));
        r.dot(&(edge.information * r))
    }

    /// Half the sum of the edges' losses, and the costs of the condensed parts.
    pub fn cost(&self, metric: Metric) -> f64 {
        let edges: f64 = self.edges.iter().map(|e| 0.5 * e.loss.of(self.chi2(e, metric)).0).sum();
        edges + self.condensed.iter().map(|c| c.cost(&self.values)).sum::<f64>()
    }

    /// Adds what another graph says about vertices of this one ([`PoseGraph::condense`]). Returns its index.
    ///
    /// # Errors
    /// When a vertex does not exist or is named twice, or a size or number is wrong.
    pub fn add_condensed(&mut self, condensed: Condensed<G, D>) -> Result<usize, CondensedError> {
        condensed.check(self.values.len())?;
        self.condensed.push(condensed);
        Ok(self.condensed.len() - 1)
    }

    /// The condensed parts of other graphs.
    pub fn condensed(&self) -> &[Condensed<G, D>] {
        &self.condensed
    }

    /// Sets the fixed vertices.
    ///
    /// # Panics
    /// When there is not one flag for each vertex.
    pub fn set_fixed(&mut self, fixed: &[bool]) {
        self.fixed.copy_from_slice(fixed);
    }

    /// `measured^-1 * (a^-1 * b)`.
    fn error(&self, edge: &Edge<G, D>) -> G {
        let relative = self.values[edge.a].inverse().compose(&self.values[edge.b]);
        edge.a_from_b.inverse().compose(&relative)
    }

    /// For each vertex, the first one of its connected component. An edge without information connects nothing.
    pub fn components(&self) -> Vec<usize> {
        let mut root: Vec<usize> = (0..self.values.len()).collect();
        fn find(root: &mut [usize], mut i: usize) -> usize {
            while root[i] != i {
                root[i] = root[root[i]];
                i = root[i];
            }
            i
        }
        let stars = self.condensed.iter().flat_map(|c| c.vertices().iter().map(|v| (c.vertices()[0], *v)));
        let edges = self.edges.iter().filter(|e| e.information.amax() > 0.0);
        for (a, b) in edges.map(|e| (e.a, e.b)).chain(stars) {
            let (a, b) = (find(&mut root, a), find(&mut root, b));
            root[a.max(b)] = a.min(b);
        }
        (0..root.len()).map(|i| find(&mut root, i)).collect()
    }

    /// Which vertices are held while solving: the fixed ones, and the first of each component without any.
    pub fn held(&self) -> Vec<bool> {
        let components = self.components();
        let mut anchored = vec![false; self.values.len()];
        for (component, _) in components.iter().zip(&self.fixed).filter(|(_, fixed)| **fixed) {
            anchored[*component] = true;
        }
        let held = |i: usize| self.fixed[i] || (components[i] == i && !anchored[i]);
        (0..self.values.len()).map(held).collect()
    }
}

/// The residual of an error.
fn residual<G: LieGroup<D>, const D: usize>(error: &G, metric: Metric) -> SVector<f64, D> {
    match metric {
        Metric::Geodesic => error.coordinates(),
        Metric::Chordal => error.chordal(),
    }
}

/// The symmetric positive semi-definite matrix nearest to a symmetric one in the Frobenius norm: negative eigenvalues
/// become zero. `None` when an entry is not finite or the eigenvalues are not found.
///
/// Source: Higham, "Computing a nearest symmetric positive semidefinite matrix" (1988), theorem 2.1.
pub fn nearest_semi_definite<const D: usize>(m: &SMatrix<f64, D, D>) -> Option<SMatrix<f64, D, D>> {
    if !m.iter().all(|v| v.is_finite()) {
        return None;
    }
    let symmetric = nalgebra::DMatrix::from_fn(D, D, |r, c| 0.5 * (m[(r, c)] + m[(c, r)]));
    let eigen = nalgebra::SymmetricEigen::try_new(symmetric, 1e-15, 1000)?;
    let clipped = eigen.eigenvalues.map(|v| v.max(0.0));
    let product =
        &eigen.eigenvectors * nalgebra::DMatrix::from_diagonal(&clipped) * eigen.eigenvectors.transpose();
    Some(SMatrix::from_fn(|r, c| 0.5 * (product[(r, c)] + product[(c, r)])))
}

/// Whether a matrix is symmetric, finite and has no eigenvalue that is clearly negative.
pub fn semi_definite<const D: usize>(m: &SMatrix<f64, D, D>) -> bool {
    let largest = m.amax();
    let symmetric = (m - m.transpose()).amax() <= 1e-6 * largest;
    let lifted = m + SMatrix::<f64, D, D>::identity() * (1e-9 * largest);
    largest.is_finite() && symmetric && (largest == 0.0 || Cholesky::new(lifted).is_some())
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn nearest_semi_definite_clips_negative_eigenvalues_only() {
        let good = Matrix3::new(4.0, 1.0, 0.0, 1.0, 3.0, 0.5, 0.0, 0.5, 2.0);
        assert!((nearest_semi_definite(&good).unwrap() - good).amax() < 1e-12);
        // Eigenvalues 3 and -1 in the first two, 5 in the last.
        let bad = Matrix3::new(1.0, 2.0, 0.0, 2.0, 1.0, 0.0, 0.0, 0.0, 5.0);
        assert!(!semi_definite(&bad));
        let nearest = nearest_semi_definite(&bad).unwrap();
        assert!((nearest - Matrix3::new(1.5, 1.5, 0.0, 1.5, 1.5, 0.0, 0.0, 0.0, 5.0)).amax() < 1e-12);
        assert!(semi_definite(&nearest));
        assert!(nearest_semi_definite(&Matrix3::from_element(f64::NAN)).is_none());
    }
}
