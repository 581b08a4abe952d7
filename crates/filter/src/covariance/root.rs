//! The square root of a covariance: a lower triangular `S` with `P = S S^T`.
//!
//! All operations are Givens rotations of columns, which do not change `S S^T`: motion adds columns that are then
//! rotated into the triangle; a measurement is whitened and applied one row at a time in the array form (Kailath,
//! Sayed, Hassibi, "Linear estimation", 2000, section 12.2), from the last column to the first, which keeps `S`
//! triangular.

use super::{Rows, root3};
use nalgebra::Matrix3;

/// A lower triangular matrix, stored by columns; column `j` begins at its diagonal.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SquareRoot {
    columns: Vec<Vec<f64>>,
}

impl SquareRoot {
    /// The Cholesky factor; pivots that rounding made negative count as zero.
    pub fn from_matrix(n: usize, mut p: Vec<f64>) -> Self {
        let mut columns: Vec<Vec<f64>> = Vec::with_capacity(n);
        for j in 0..n {
            let pivot = p[j * n + j].max(0.0).sqrt();
            let scale = if pivot > 0.0 { 1.0 / pivot } else { 0.0 };
            let mut column = vec![pivot];
            column.extend(p[j * n + j + 1..(j + 1) * n].iter().map(|v| v * scale));
            for k in j + 1..n {
                let by = column[k - j];
                p[k * n + k..(k + 1) * n].iter_mut().zip(&column[k - j..]).for_each(|(v, c)| *v -= by * c);
            }
            columns.push(column);
        }
        Self { columns }
    }

    pub fn size(&self) -> usize {
        self.columns.len()
    }

    pub fn at(&self, row: usize, column: usize) -> f64 {
        (0..=row.min(column)).map(|k| self.columns[k][row - k] * self.columns[k][column - k]).sum()
    }

    /// `H S`, by rows.
    fn seen(&self, h: &Rows) -> Vec<[f64; 3]> {
        let mut seen = vec![[0.0; 3]; self.size()];
        for (offset, width, values) in &h.blocks {
            for k in 0..*width {
                let row = offset + k;
                for (j, (column, seen)) in self.columns[..=row].iter().zip(&mut seen).enumerate() {
                    (0..h.rows).for_each(|r| seen[r] += values[(r, k)] * column[row - j]);
                }
            }
        }
        seen
    }

    /// Variance of one row, without forming the matrix.
    #[cfg(test)]
    pub fn variance_of(&self, h: &Rows) -> f64 {
        self.seen(h).iter().map(|s| s[0] * s[0]).sum()
    }

    pub fn cross(&self, h: &Rows) -> Vec<f64> {
        let n = self.size();
        let seen = self.seen(h);
        let mut cross = vec![0.0; n * h.rows];
        for (j, (column, seen)) in self.columns.iter().zip(&seen).enumerate() {
            for (r, to) in cross.chunks_exact_mut(n).enumerate() {
                let by = seen[r];
                to[j..].iter_mut().zip(column).for_each(|(t, c)| *t += by * c);
            }
        }
        cross
    }

    pub fn predict(&mut self, at: usize, f: &Matrix3<f64>, q: &Matrix3<f64>) {
        // Columns before those of the pose mix its rows. `F` is upper triangular, so entries above the diagonal appear
        // only in the pose's own columns; these are set aside and rotated in again together with the noise.
        for (k, column) in self.columns.iter_mut().enumerate().take(at) {
            let own = [0, 1, 2].map(|i| column[at - k + i]);
            for i in 0..3 {
                column[at - k + i] = (0..3).map(|j| f[(i, j)] * own[j]).sum();
            }
        }
        let own = Matrix3::from_fn(|i, j| if i >= j { self.columns[at + j][i - j] } else { 0.0 });
        let moved = f * own;
        let noise = root3(q);
        let tail = self.size() - at;
        let mut extra: Vec<Vec<f64>> = Vec::new();
        for j in 0..3 {
            let mut column = vec![0.0; tail];
            (0..3).for_each(|i| column[i] = moved[(i, j)]);
            let below = &self.columns[at + j][3 - j..];
            column[3..].copy_from_slice(below);
            extra.push(column);
            self.columns[at + j].fill(0.0);
            let mut column = vec![0.0; tail];
            (0..3).for_each(|i| column[i] = noise[(i, j)]);
            extra.push(column);
        }
        for mut column in extra {
            self.rotate_in(at, &mut column);
        }
    }

    /// Adds `v v^T`, where `v` begins at row `at`.
    fn rotate_in(&mut self, at: usize, v: &mut [f64]) {
        for (j, column) in self.columns[at..].iter_mut().enumerate() {
            if v[j] == 0.0 {
                continue;
            }
            let norm = column[0].hypot(v[j]);
            let (c, s) = (column[0] / norm, v[j] / norm);
            for (l, v) in column.iter_mut().zip(&mut v[j..]) {
                (*l, *v) = (c * *l + s * *v, c * *v - s * *l);
            }
        }
    }

    pub fn update(&mut self, h: &Rows, noise: &Matrix3<f64>) {
        let rows = h.rows;
        let whole = Matrix3::from_fn(|i, j| match (i < rows && j < rows, i == j) {
            (true, _) => noise[(i, j)],
            (false, same) => f64::from(same),
        });
        // Whitened rows are independent: `L^-1 H`, with unit noise.
        let l = root3(&whole);
        let Some(whiten) = l.try_inverse() else { return };
        let white = Rows {
            rows,
            blocks: h.blocks.iter().map(|(at, width, values)| (*at, *width, whiten * values)).collect(),
        };
        for r in 0..rows {
            let row = |m: &Matrix3<f64>| Matrix3::from_fn(|i, j| if i == 0 { m[(r, j)] } else { 0.0 });
            let blocks = white.blocks.iter().map(|(at, width, values)| (*at, *width, row(values))).collect();
            self.update_row(&Rows { rows: 1, blocks });
        }
    }

    /// Updates by one row with unit noise.
    fn update_row(&mut self, h: &Rows) {
        let seen = self.seen(h);
        let n = self.size();
        let (mut root, mut carried) = (1.0_f64, vec![0.0; n]);
        for j in (0..n).rev() {
            let a = seen[j][0];
            let norm = root.hypot(a);
            let (c, s) = (root / norm, a / norm);
            root = norm;
            for (l, k) in self.columns[j].iter_mut().zip(&mut carried[j..]) {
                (*l, *k) = (c * *l - s * *k, c * *k + s * *l);
            }
        }
    }

    pub fn shear(&mut self, d: &[f64], at: usize) {
        let own: Vec<f64> = (0..=at).map(|k| self.columns[k][at - k]).collect();
        for (k, (column, own)) in self.columns.iter_mut().zip(&own).enumerate() {
            column[at + 1 - k..].iter_mut().zip(&d[at + 1..]).for_each(|(v, d)| *v += d * own);
        }
        // The rows above the heading are the position of its pose; they are made triangular again.
        let first = at - 2;
        let f = Matrix3::new(1.0, 0.0, d[first], 0.0, 1.0, d[first + 1], 0.0, 0.0, 1.0);
        self.predict(first, &f, &Matrix3::zeros());
    }

    pub fn augment(&mut self, g: &Rows, noise: &Matrix3<f64>) {
        let seen = self.seen(g);
        for (column, seen) in self.columns.iter_mut().zip(&seen) {
            column.extend_from_slice(&seen[..g.rows]);
        }
        let own = root3(&Matrix3::from_fn(|i, j| if i < g.rows && j < g.rows { noise[(i, j)] } else { 0.0 }));
        self.columns.extend((0..g.rows).map(|j| (j..g.rows).map(|i| own[(i, j)]).collect()));
    }

    pub fn remove(&mut self, at: usize, size: usize) {
        for _ in 0..size {
            let mut freed = self.columns.remove(at);
            for (k, column) in self.columns.iter_mut().enumerate().take(at) {
                column.remove(at - k);
            }
            // The rest of the removed column still contributes to the columns after it.
            freed.remove(0);
            self.rotate_in(at, &mut freed);
        }
    }
}
