//! A part of another graph, condensed to some of its vertices: a Gaussian over their poses relative to one of them.
//!
//! Where a part of a graph is known only by measurements between its poses, its cost does not change when all of them move
//! as one. Written over poses relative to a base it keeps this exactly, so that it still holds after the whole part has
//! been turned by any angle. Sources: Ni, Steedly, Dellaert, "Tectonic SAM" (2007), for the base; Grisetti, Kuemmerle, Ni,
//! "Robust optimization of factor graphs by using condensed measurements" (2012); square root form as in Dellaert and
//! Kaess, "Factor graphs for robot perception" (2017), chapter 5.

use super::Edge;
use crate::Loss;
use cairn_geometry::LieGroup;
use nalgebra::{DMatrix, DVector, SMatrix, SVector};

/// The cost `1/2 |R y - z|^2`, where `y` stacks the coordinates of `base_from_vertex^-1 * (base^-1 * vertex)` of every vertex
/// but the base.
#[derive(Clone, Debug, PartialEq)]
pub struct Condensed<G, const D: usize> {
    vertices: Vec<usize>,
    base_from_vertex: Vec<G>,
    root: DMatrix<f64>,
    rhs: DVector<f64>,
    /// `R^T R`.
    information: DMatrix<f64>,
}

/// Why a condensed part was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CondensedError {
    /// It names a vertex that does not exist.
    #[error("vertex {0} does not exist")]
    NoVertex(usize),
    /// It names a vertex twice.
    #[error("vertex {0} is named twice")]
    Twice(usize),
    /// It has fewer than two vertices, or its poses, root and right side do not fit them.
    #[error("it has the wrong size")]
    Size,
    /// A number is not finite.
    #[error("a number is not finite")]
    NotFinite,
}

/// A condensed part at a state: `H`, the gradient by each vertex, and the cost.
pub(super) struct CondensedLinear<const D: usize> {
    blocks: Vec<SMatrix<f64, D, D>>,
    pub gradient: Vec<SVector<f64, D>>,
    pub cost: f64,
}

impl<const D: usize> CondensedLinear<D> {
    /// The block of two vertices, by their places.
    pub fn block(&self, row: usize, column: usize) -> SMatrix<f64, D, D> {
        self.blocks[row * self.gradient.len() + column]
    }
}

/// Pairs of `n` places, the first greater than the second.
pub(super) fn pair_indices(n: usize) -> impl Iterator<Item = (usize, usize)> {
    (1..n).flat_map(|k| (0..k).map(move |l| (k, l)))
}

impl<G: LieGroup<D>, const D: usize> Condensed<G, D> {
    /// From its vertices (the base first), the poses of all others in the base where it was linearised, the square upper
    /// triangular `R` of `D` rows for each of them, and `z`.
    ///
    /// # Errors
    /// When sizes do not fit, or a number is not finite.
    pub fn new(
        vertices: Vec<usize>,
        base_from_vertex: Vec<G>,
        root: DMatrix<f64>,
        rhs: DVector<f64>,
    ) -> Result<Self, CondensedError> {
        let n = base_from_vertex.len() * D;
        if vertices.len() < 2 || vertices.len() != base_from_vertex.len() + 1 {
            return Err(CondensedError::Size);
        }
        if root.shape() != (n, n) || rhs.len() != n {
            return Err(CondensedError::Size);
        }
        let finite = root.iter().chain(rhs.iter()).all(|v| v.is_finite());
        if !finite || !base_from_vertex.iter().all(|p| p.is_finite()) {
            return Err(CondensedError::NotFinite);
        }
        let information = root.tr_mul(&root);
        Ok(Self { vertices, base_from_vertex, root, rhs, information })
    }

    /// Its vertices, the base first.
    pub fn vertices(&self) -> &[usize] {
        &self.vertices
    }

    /// Poses of all vertices but the base, in the base, where it was linearised.
    pub fn base_from_vertex(&self) -> &[G] {
        &self.base_from_vertex
    }

    /// The upper triangular `R`.
    pub fn root(&self) -> &DMatrix<f64> {
        &self.root
    }

    /// The right side `z`.
    pub fn rhs(&self) -> &DVector<f64> {
        &self.rhs
    }

    /// The same about other vertices: `to[k]` for the vertex `k`.
    ///
    /// # Panics
    /// When there is no `to[k]` for one of its vertices.
    #[must_use]
    pub fn renamed(mut self, to: &[usize]) -> Self {
        self.vertices.iter_mut().for_each(|v| *v = to[*v]);
        self
    }

    /// `1/2 |R y - z|^2` with the vertices at these poses.
    ///
    /// # Panics
    /// When a vertex is not among them.
    pub fn cost(&self, values: &[G]) -> f64 {
        let (y, _) = self.relative(values);
        0.5 * (&self.root * y - &self.rhs).norm_squared()
    }

    pub(super) fn check(&self, vertices: usize) -> Result<(), CondensedError> {
        let mut sorted = self.vertices.clone();
        sorted.sort_unstable();
        if let Some(v) = sorted.last().filter(|v| **v >= vertices) {
            return Err(CondensedError::NoVertex(*v));
        }
        match sorted.windows(2).find(|w| w[0] == w[1]) {
            Some(w) => Err(CondensedError::Twice(w[0])),
            None => Ok(()),
        }
    }

    /// All pairs of its vertices, in the order of [`pair_indices`].
    pub(super) fn pairs(&self) -> impl Iterator<Item = (usize, usize)> {
        pair_indices(self.vertices.len()).map(|(k, l)| (self.vertices[k], self.vertices[l]))
    }

    /// The coordinates `y`, and the errors that they are the coordinates of.
    fn relative(&self, values: &[G]) -> (DVector<f64>, Vec<G>) {
        let from_base = values[self.vertices[0]].inverse();
        let errors: Vec<G> = self.vertices[1..]
            .iter()
            .zip(&self.base_from_vertex)
            .map(|(v, expected)| expected.inverse().compose(&from_base.compose(&values[*v])))
            .collect();
        let y = DVector::from_iterator(self.rhs.len(), errors.iter().flat_map(coordinates));
        (y, errors)
    }

    pub(super) fn linearise(&self, values: &[G]) -> CondensedLinear<D> {
        let (y, errors) = self.relative(values);
        let residual = &self.root * y - &self.rhs;
        let slope = self.root.tr_mul(&residual);
        let n = self.vertices.len();
        let mut blocks = vec![SMatrix::zeros(); n * n];
        let mut gradient = vec![SVector::zeros(); n];
        let jacobians: Vec<SMatrix<f64, D, D>> = errors.iter().map(|e| e.coordinates_jacobian()).collect();
        // A vertex that moves moves its own pose; the base moves all of them, through the adjoints and with the other sign.
        let base = values[self.vertices[0]];
        let adjoints: Vec<SMatrix<f64, D, D>> =
            self.vertices[1..].iter().map(|v| values[*v].inverse().compose(&base).adjoint()).collect();
        for k in 1..n {
            let own: SVector<f64, D> = slope.fixed_rows::<D>((k - 1) * D).into();
            let own = jacobians[k - 1].tr_mul(&own);
            gradient[0] -= adjoints[k - 1].tr_mul(&own);
            gradient[k] = own;
            for l in 1..n {
                let information = self.information.fixed_view::<D, D>((k - 1) * D, (l - 1) * D);
                let block = jacobians[k - 1].tr_mul(&(information * jacobians[l - 1]));
                blocks[l] -= adjoints[k - 1].tr_mul(&block);
                blocks[k * n + l] = block;
            }
        }
        for l in 1..n {
            let across = blocks[l];
            blocks[0] -= across * adjoints[l - 1];
            blocks[l * n] = across.transpose();
        }
        CondensedLinear { blocks, gradient, cost: 0.5 * residual.norm_squared() }
    }

    /// Each pose relative to the base as a measurement of its own, with its marginal information: for starts.
    pub(super) fn star(&self) -> Vec<Edge<G, D>> {
        let n = self.rhs.len();
        let Some(inverse) = self.root.solve_upper_triangular(&DMatrix::identity(n, n)) else {
            return Vec::new();
        };
        let best = &inverse * &self.rhs;
        let edge = |k: usize| {
            let rows = inverse.rows(k * D, D);
            let covariance: SMatrix<f64, D, D> = (rows * rows.transpose()).fixed_view::<D, D>(0, 0).into();
            let step: SVector<f64, D> = best.fixed_rows::<D>(k * D).into();
            let information = covariance.cholesky()?.inverse();
            let a_from_b = self.base_from_vertex[k].retract(&step);
            let (a, b) = (self.vertices[0], self.vertices[k + 1]);
            Some(Edge { a, b, a_from_b, information, loss: Loss::Squared })
        };
        (0..self.base_from_vertex.len()).filter_map(edge).collect()
    }
}

fn coordinates<G: LieGroup<D>, const D: usize>(g: &G) -> [f64; D] {
    g.coordinates().into()
}
