//! The updates to apply to the passive part of the map when the robot returns; see `passive.rs` for their equations.

use crate::covariance::Rows;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Index of the heading of the first robot.
pub(crate) const HEADING: usize = 2;

/// Updates that the passive part has not received yet.
///
/// In the invariant filter every passive position is turned with the heading, by corrections as well as by the noise of
/// motion. So its matrices are as wide as [`Deferred::columns`] makes the rows of the passive part: pairs of columns that
/// are the real and imaginary part of one complex number, the first pair being the position itself.
#[derive(Clone, Debug)]
pub(crate) struct Deferred {
    /// Present active size by width, by rows: rows are added and removed together with variables.
    pub phi: Vec<Vec<f64>>,
    pub psi: DMatrix<f64>,
    pub theta: DVector<f64>,
    /// What the measurements of the present correction add to `theta`.
    moved: DVector<f64>,
    turns: bool,
}

impl Deferred {
    /// For `n` active variables; `turns` for the invariant filter.
    pub fn new(n: usize, turns: bool) -> Self {
        let width = if turns { 2 * n + 2 } else { n };
        let own = |i: usize| if turns { 2 * i + 2 } else { i };
        let unit = |i: usize| (0..width).map(|j| f64::from(u8::from(own(i) == j))).collect();
        Self {
            phi: (0..n).map(unit).collect(),
            psi: DMatrix::zeros(width, width),
            theta: DVector::zeros(width),
            moved: DVector::zeros(width),
            turns,
        }
    }

    /// The two rows of a passive landmark at `x`, `y` in these columns, from those of its covariance with the active
    /// part (`cross`): `[p, i p]` for each complex number `p`.
    pub fn columns(x: f64, y: f64, cross: impl Iterator<Item = (f64, f64)>) -> [Vec<f64>; 2] {
        let all: Vec<(f64, f64)> = std::iter::once((x, y)).chain(cross).collect();
        [all.iter().flat_map(|(x, y)| [*x, -y]).collect(), all.iter().flat_map(|(x, y)| [*y, *x]).collect()]
    }

    /// A passive position turned by a right angle, in these columns.
    fn across(&self) -> DVector<f64> {
        let mut at = self.theta.clone();
        at[0] += 1.0;
        DVector::from_fn(at.len(), |k, _| if k % 2 == 0 { -at[k + 1] } else { at[k - 1] })
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

    /// Propagates the pose at `at` with this noise.
    pub fn predict(&mut self, at: usize, f: &Matrix3<f64>, noise: &Matrix3<f64>) {
        let rows: [Vec<f64>; 3] = std::array::from_fn(|k| std::mem::take(&mut self.phi[at + k]));
        for i in 0..3 {
            let of = |c: usize| (0..3).map(|k| f[(i, k)] * rows[k][c]).sum();
            self.phi[at + i] = (0..rows[0].len()).map(of).collect();
        }
        if self.turns && at + 2 == HEADING {
            // An error of the heading is one of every position relative to it.
            let across = self.across();
            for j in 0..3 {
                self.phi[at + j].iter_mut().zip(&across).for_each(|(p, a)| *p -= a * noise[(2, j)]);
            }
            self.psi.ger(-noise[(2, 2)], &across, &across, 1.0);
        }
    }

    pub fn shear(&mut self, d: &[f64], at: usize) {
        let own = self.phi[at].clone();
        for (row, by) in self.phi.iter_mut().zip(d) {
            row.iter_mut().zip(&own).for_each(|(p, o)| *p += by * o);
        }
    }

    /// Ends a correction, which turns the heading by this angle.
    pub fn correct(&mut self, angle: f64) {
        if self.turns {
            let across = self.across();
            self.theta.axpy(angle, &across, 1.0);
        }
        self.theta += &self.moved;
        self.moved.fill(0.0);
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
                self.moved[j] += by * innovation[r];
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
