//! Normal equations of a chain of states with a few unknowns shared by all of them, solved block by block.
//!
//! The Hessian is block tridiagonal with an arrow: each state of nine touches the next and the shared ones. Eliminating
//! the states in order leaves the shared unknowns, whose reduced Hessian's inverse is their covariance (Triggs et al. 2000,
//! section 6.2, for a chain). Work grows with the number of states alone.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Unknowns of a state.
pub const STATE: usize = 9;
/// Unknowns shared by all states.
pub const SHARED: usize = 14;

pub type Block = SMatrix<f64, STATE, STATE>;
pub type Edge = SMatrix<f64, STATE, SHARED>;
pub type Shared = SMatrix<f64, SHARED, SHARED>;

/// The equations `H x = -b`.
#[derive(Clone)]
pub struct Chain {
    pub diagonal: Vec<Block>,
    /// State `k` with state `k + 1`.
    pub next: Vec<Block>,
    pub edge: Vec<Edge>,
    pub shared: Shared,
    pub gradient: Vec<SVector<f64, STATE>>,
    pub shared_gradient: SVector<f64, SHARED>,
}

/// A solution.
pub struct Step {
    pub states: Vec<SVector<f64, STATE>>,
    pub shared: SVector<f64, SHARED>,
    /// Of the shared unknowns, all states marginalised.
    pub covariance: Shared,
    /// Half the logarithm of the Hessian's determinant.
    pub half_log_det: f64,
}

impl Chain {
    /// Zero equations of `n` states.
    pub fn new(n: usize) -> Self {
        Self {
            diagonal: vec![Block::zeros(); n],
            next: vec![Block::zeros(); n.saturating_sub(1)],
            edge: vec![Edge::zeros(); n],
            shared: Shared::zeros(),
            gradient: vec![SVector::zeros(); n],
            shared_gradient: SVector::zeros(),
        }
    }

    /// Adds whitened rows that touch state `k`, state `k + 1` and the shared unknowns.
    pub fn add<const R: usize>(
        &mut self,
        k: usize,
        by_first: &SMatrix<f64, R, STATE>,
        by_second: &SMatrix<f64, R, STATE>,
        by_shared: &SMatrix<f64, R, SHARED>,
        residual: &SVector<f64, R>,
    ) {
        self.diagonal[k] += by_first.transpose() * by_first;
        self.diagonal[k + 1] += by_second.transpose() * by_second;
        self.next[k] += by_first.transpose() * by_second;
        self.edge[k] += by_first.transpose() * by_shared;
        self.edge[k + 1] += by_second.transpose() * by_shared;
        self.shared += by_shared.transpose() * by_shared;
        self.gradient[k] += by_first.transpose() * residual;
        self.gradient[k + 1] += by_second.transpose() * residual;
        self.shared_gradient += by_shared.transpose() * residual;
    }

    /// The step with the diagonal raised by the part `lambda` of itself; `None` when the equations are singular.
    pub fn solve(&self, lambda: f64) -> Option<Step> {
        let Reduced { eliminated, covariance, shared_gradient, half_log_det } = self.eliminate(lambda)?;
        let common = -(covariance * shared_gradient);
        let mut states = vec![SVector::zeros(); eliminated.len()];
        for (k, Eliminated { inverse, edge, gradient }) in eliminated.iter().enumerate().rev() {
            let mut rest = gradient + edge * common;
            if let Some(after) = states.get(k + 1) {
                rest += self.next[k] * after;
            }
            states[k] = -(inverse * rest);
        }
        Some(Step { states, shared: common, covariance, half_log_det })
    }

    /// The columns of the Hessian's inverse that belong to the shared unknowns: by state, and of the shared ones themselves.
    pub fn shared_columns(&self) -> Option<(Vec<Edge>, Shared)> {
        let Reduced { eliminated, covariance, .. } = self.eliminate(0.0)?;
        let mut states = vec![Edge::zeros(); eliminated.len()];
        for (k, Eliminated { inverse, edge, .. }) in eliminated.iter().enumerate().rev() {
            let mut rest = edge * covariance;
            if let Some(after) = states.get(k + 1) {
                rest += self.next[k] * after;
            }
            states[k] = -(inverse * rest);
        }
        Some((states, covariance))
    }

    /// All states eliminated, in order.
    fn eliminate(&self, lambda: f64) -> Option<Reduced> {
        let n = self.diagonal.len();
        let mut half_log_det = 0.0;
        let mut shared = self.shared;
        for i in 0..SHARED {
            shared[(i, i)] *= 1.0 + lambda;
        }
        let mut shared_gradient = self.shared_gradient;
        let mut eliminated: Vec<Eliminated> = Vec::with_capacity(n);
        for k in 0..n {
            let (mut h, mut e, mut b) = (self.diagonal[k], self.edge[k], self.gradient[k]);
            for i in 0..STATE {
                h[(i, i)] *= 1.0 + lambda;
            }
            if let Some(before) = eliminated.last() {
                let carried = self.next[k - 1].transpose() * before.inverse;
                h -= carried * self.next[k - 1];
                e -= carried * before.edge;
                b -= carried * before.gradient;
            }
            let factor = Cholesky::new(h)?;
            half_log_det += log_diagonal(&factor.l());
            let inverse = factor.inverse();
            let weighted = e.transpose() * inverse;
            shared -= weighted * e;
            shared_gradient -= weighted * b;
            eliminated.push(Eliminated { inverse, edge: e, gradient: b });
        }
        let factor = Cholesky::new(shared)?;
        half_log_det += log_diagonal(&factor.l());
        Some(Reduced { eliminated, covariance: factor.inverse(), shared_gradient, half_log_det })
    }
}

/// A state after elimination of those before it.
struct Eliminated {
    /// Of its block.
    inverse: Block,
    edge: Edge,
    gradient: SVector<f64, STATE>,
}

/// The equations of the shared unknowns that are left.
struct Reduced {
    eliminated: Vec<Eliminated>,
    /// The inverse of their Hessian.
    covariance: Shared,
    shared_gradient: SVector<f64, SHARED>,
    half_log_det: f64,
}

/// Sum of the logarithms of a matrix's diagonal.
fn log_diagonal<const N: usize>(lower: &SMatrix<f64, N, N>) -> f64 {
    lower.diagonal().iter().map(|x| x.ln()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;
    use nalgebra::{DMatrix, DVector};

    #[test]
    fn agrees_with_a_dense_solver() {
        let n = 5;
        let mut rng = Random::new(1);
        let mut chain = Chain::new(n);
        let size = n * STATE + SHARED;
        let (mut h, mut b) = (DMatrix::<f64>::zeros(size, size), DVector::<f64>::zeros(size));
        for k in 0..n - 1 {
            let by_first = SMatrix::<f64, 12, STATE>::from_fn(|_, _| rng.standard_normal());
            let by_second = SMatrix::<f64, 12, STATE>::from_fn(|_, _| rng.standard_normal());
            let by_shared = SMatrix::<f64, 12, SHARED>::from_fn(|_, _| rng.standard_normal());
            let residual = SVector::<f64, 12>::from_fn(|_, _| rng.standard_normal());
            chain.add(k, &by_first, &by_second, &by_shared, &residual);
            let mut row = DMatrix::<f64>::zeros(12, size);
            row.view_mut((0, k * STATE), (12, STATE)).copy_from(&by_first);
            row.view_mut((0, (k + 1) * STATE), (12, STATE)).copy_from(&by_second);
            row.view_mut((0, n * STATE), (12, SHARED)).copy_from(&by_shared);
            h += row.transpose() * &row;
            b += row.transpose() * residual;
        }
        // Regular, as priors make it.
        for i in 0..size {
            h[(i, i)] += 0.3;
        }
        for k in 0..n {
            chain.diagonal[k] += Block::identity() * 0.3;
        }
        chain.shared += Shared::identity() * 0.3;
        let inverse = h.clone().try_inverse().unwrap();
        let half_log_det = 0.5 * h.determinant().ln();
        let x = -(&inverse * b);
        let step = chain.solve(0.0).unwrap();
        for k in 0..n {
            assert!((step.states[k] - x.fixed_rows::<STATE>(k * STATE)).norm() < 1e-9);
        }
        assert!((step.half_log_det - half_log_det).abs() < 1e-9);
        assert!((step.shared - x.fixed_rows::<SHARED>(n * STATE)).norm() < 1e-9);
        assert!((step.covariance - inverse.fixed_view::<SHARED, SHARED>(n * STATE, n * STATE)).norm() < 1e-9);
        let (columns, covariance) = chain.shared_columns().unwrap();
        assert_eq!(covariance, step.covariance);
        for (k, column) in columns.iter().enumerate() {
            assert!((column - inverse.fixed_view::<STATE, SHARED>(k * STATE, n * STATE)).norm() < 1e-9);
        }
    }
}
