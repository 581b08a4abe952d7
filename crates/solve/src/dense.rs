//! Problems of a few unknowns, with normal equations in stack memory: poses, relative motions.

use crate::levenberg_marquardt::{LevenbergMarquardt, Outcome, Problem, Trial};
use nalgebra::{SMatrix, SVector};

/// Normal equations `hessian * step = -gradient` at one state, and its cost.
#[derive(Clone, Copy, Debug)]
pub struct DenseNormal<const N: usize> {
    /// Sum of the weighted `J^T J`.
    pub hessian: SMatrix<f64, N, N>,
    /// Sum of the weighted `J^T r`.
    pub gradient: SVector<f64, N>,
    /// Half the robust sum of squares.
    pub cost: f64,
}

/// Minimises a problem of `N` unknowns from a first state: `linearise` gives the normal equations at a state, `retract`
/// moves a state by a step. The diagonal is raised by the damping times itself and by `floor`.
///
/// Returns the best state with its normal equations. A state is linearised once, whether it is accepted or not.
pub fn minimise_dense<S: Copy, const N: usize>(
    solver: &LevenbergMarquardt,
    start: &S,
    floor: f64,
    linearise: impl Fn(&S) -> DenseNormal<N>,
    retract: impl Fn(&S, &SVector<f64, N>) -> S,
) -> (S, DenseNormal<N>, Outcome) {
    let now = (*start, linearise(start));
    let mut dense = Dense { now, trial: now, floor, linearise, retract };
    let outcome = solver.minimise(&mut dense, || false);
    (dense.now.0, dense.now.1, outcome)
}

struct Dense<S, L, R, const N: usize> {
    now: (S, DenseNormal<N>),
    trial: (S, DenseNormal<N>),
    floor: f64,
    linearise: L,
    retract: R,
}

impl<S: Copy, L, R, const N: usize> Problem for Dense<S, L, R, N>
where
    L: Fn(&S) -> DenseNormal<N>,
    R: Fn(&S, &SVector<f64, N>) -> S,
{
    async fn linearise(&mut self) -> Option<f64> {
        Some(self.now.1.cost)
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let (state, normal) = &self.now;
        let mut hessian = normal.hessian;
        for k in 0..N {
            hessian[(k, k)] += damping * normal.hessian[(k, k)] + self.floor;
        }
        let step = -hessian.cholesky()?.solve(&normal.gradient);
        let moved = (self.retract)(state, &step);
        self.trial = (moved, (self.linearise)(&moved));
        let own = |k: usize| damping * normal.hessian[(k, k)] + self.floor;
        let predicted_decrease =
            (0..N).map(|k| 0.5 * step[k] * (own(k) * step[k] - normal.gradient[k])).sum::<f64>();
        Some(Trial { cost: self.trial.1.cost, predicted_decrease })
    }

    fn accept(&mut self) {
        self.now = self.trial;
    }
}
