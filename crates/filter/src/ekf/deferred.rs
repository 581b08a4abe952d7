//! The updates to apply to the passive part of the map when the robot returns; see `passive.rs` for their equations.

use crate::covariance::Rows;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Updates that the passive part has not received yet.
#[derive(Clone, Debug)]
pub(crate) struct Deferred {
    /// Present active size by active size at the start, by rows: rows are added and removed together with variables.
    pub phi: Vec<Vec<f64>>,
    pub psi: DMatrix<f64>,
    pub theta: DVector<f64>,
}

impl Deferred {
    pub fn new(n: usize) -> Self {
        let unit = |i: usize| (0..n).map(|j| f64::from(i == j)).collect();
        Self { phi: (0..n).map(unit).collect(), psi: DMatrix::zeros(n, n), theta: DVector::zeros(n) }
    }

    /// `H phi`, by rows.
    fn seen(&self, h: &Rows) -> Vec<Vec<f64>> {
        let mut seen = vec![vec![0.0; self.theta.len()]; h.rows];
        for (at, width, values) in &h.blocks {
            for k in 0..*width {
                for (r, seen) in seen.iter_mut().enumerate() {
                    let by = values[(r, k)];
                    seen.iter_mut().zip(&self.phi[at + k]).for_each(|(s, p)| *s += by * p);
                }
            }
        }
        seen
    }

    pub fn augment(&mut self, g: &Rows) {
        let rows = self.seen(g);
        self.phi.extend(rows);
    }

    pub fn remove(&mut self, at: usize, size: usize) {
        self.phi.drain(at..at + size);
    }

    pub fn predict(&mut self, at: usize, f: &Matrix3<f64>) {
        let rows: [Vec<f64>; 3] = std::array::from_fn(|k| std::mem::take(&mut self.phi[at + k]));
        for i in 0..3 {
            let of = |c: usize| (0..3).map(|k| f[(i, k)] * rows[k][c]).sum();
            self.phi[at + i] = (0..rows[0].len()).map(of).collect();
        }
    }

    pub fn shear(&mut self, d: &[f64], at: usize) {
        let own = self.phi[at].clone();
        for (row, by) in self.phi.iter_mut().zip(d) {
            row.iter_mut().zip(&own).for_each(|(p, o)| *p += by * o);
        }
    }

    /// Accumulates a measurement with this gain (column-major), inverse innovation covariance and innovation.
    pub fn update(&mut self, h: &Rows, gain: &[f64], inverse: &Matrix3<f64>, innovation: &Vector3<f64>) {
        let seen = self.seen(h);
        let n = self.phi.len();
        for r in 0..h.rows {
            // A row of S^-1 H phi.
            let mut weighted = vec![0.0; self.theta.len()];
            for (k, seen) in seen.iter().enumerate() {
                weighted.iter_mut().zip(seen).for_each(|(w, s)| *w += inverse[(r, k)] * s);
            }
            for (j, by) in weighted.iter().enumerate() {
                self.theta[j] += by * innovation[r];
                self.psi.column_mut(j).iter_mut().zip(&seen[r]).for_each(|(p, s)| *p += by * s);
            }
        }
        for (r, seen) in seen.iter().enumerate() {
            for (row, by) in self.phi.iter_mut().zip(&gain[r * n..(r + 1) * n]) {
                row.iter_mut().zip(seen).for_each(|(p, s)| *p -= by * s);
            }
        }
    }
}
