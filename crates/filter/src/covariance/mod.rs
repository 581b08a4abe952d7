//! The covariance of a state that grows and shrinks, updated in Joseph form (Bucy and Joseph, 1968).
//!
//! `(I - K H) P (I - K H)^T + K R K^T` keeps a covariance positive definite under rounding, and is correct for every
//! gain. `H` touches few variables, so it is computed as `A = P - K (P H^T)^T`, then `A + (K R - A H^T) K^T`: both
//! updates have rank one to three.

use nalgebra::Matrix3;

/// Up to three rows of a measurement's Jacobian: a few 3-column blocks, each with its position in the state. Rows past
/// `rows`, and columns past the width of a block, are zero.
#[derive(Clone, Debug, PartialEq)]
pub struct Rows {
    /// Number of rows.
    pub rows: usize,
    /// First column, number of columns, and values of each block.
    pub blocks: Vec<(usize, usize, Matrix3<f64>)>,
}

impl Rows {
    /// The product of one row and a vector as long as the state.
    pub fn row_times(&self, row: usize, vector: &[f64]) -> f64 {
        let of = |(at, width, values): &(usize, usize, Matrix3<f64>)| -> f64 {
            vector[*at..at + width].iter().enumerate().map(|(k, v)| values[(row, k)] * v).sum()
        };
        self.blocks.iter().map(of).sum()
    }
}

/// A symmetric matrix, with both triangles stored.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Covariance {
    n: usize,
    /// In column-major order.
    p: Vec<f64>,
}

impl Covariance {
    /// From a symmetric positive semi-definite matrix of `n` rows, in column-major order.
    pub fn from_matrix(n: usize, p: Vec<f64>) -> Self {
        Self { n, p }
    }

    /// One entry.
    pub fn at(&self, row: usize, column: usize) -> f64 {
        self.p[column * self.n + row]
    }

    /// The block of this height and width, at most 3, at a row and a column; entries beyond are zero.
    pub fn block(&self, row: usize, height: usize, column: usize, width: usize) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| if i < height && j < width { self.at(row + i, column + j) } else { 0.0 })
    }

    /// The whole matrix in column-major order.
    pub fn matrix(&self) -> &[f64] {
        &self.p
    }

    /// `P H^T`, in column-major order.
    pub fn cross(&self, h: &Rows) -> Vec<f64> {
        cross_of(&self.p, self.n, h)
    }

    /// Propagates the pose at `at`: `P = F P F^T + Q`, where `f` and `q` are the blocks of the pose; elsewhere `F` is
    /// the identity and `Q` is zero. `F` is upper triangular.
    pub fn predict(&mut self, at: usize, f: &Matrix3<f64>, q: &Matrix3<f64>) {
        let n = self.n;
        let rows: [Vec<f64>; 3] = std::array::from_fn(|i| {
            let mut row = vec![0.0; n];
            for k in 0..3 {
                let source = &self.p[(at + k) * n..][..n];
                row.iter_mut().zip(source).for_each(|(r, s)| *r += f[(i, k)] * s);
            }
            row
        });
        let own = Matrix3::from_fn(|i, j| rows[i][at + j]) * f.transpose() + q;
        for (i, row) in rows.iter().enumerate() {
            self.p[(at + i) * n..][..n].copy_from_slice(row);
            for (column, v) in row.iter().enumerate() {
                self.p[column * n + at + i] = *v;
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                self.p[(at + j) * n + at + i] = 0.5 * (own[(i, j)] + own[(j, i)]);
            }
        }
    }

    /// Updates by a measurement: `gain` and `cross` (`P H^T`) in column-major order, `noise` its covariance.
    pub fn update(&mut self, h: &Rows, cross: &[f64], gain: &[f64], noise: &Matrix3<f64>) {
        let n = self.n;
        add_product(&mut self.p, n, gain, cross, -1.0);
        let mut left = cross_of(&self.p, n, h);
        for (r, column) in left.chunks_exact_mut(n).enumerate() {
            column.iter_mut().for_each(|v| *v = -*v);
            for (k, gain) in gain.chunks_exact(n).enumerate() {
                column.iter_mut().zip(gain).for_each(|(v, g)| *v += g * noise[(k, r)]);
            }
        }
        add_product(&mut self.p, n, &left, gain, 1.0);
        self.symmetrise();
    }

    /// Adds `d` times the variable at `at` to all: `P = (I + d e^T) P (I + d e^T)^T`, where `d` is zero at `at` itself.
    pub fn shear(&mut self, d: &[f64], at: usize) {
        let n = self.n;
        let own = self.p[at * n..(at + 1) * n].to_vec();
        let variance = own[at];
        for (j, column) in self.p.chunks_exact_mut(n).enumerate() {
            let (by_d, by_own) = (own[j] + variance * d[j], d[j]);
            column.iter_mut().zip(d).zip(&own).for_each(|((v, d), o)| *v += by_d * d + by_own * o);
        }
    }

    /// Appends as many variables (2 or 3) as `g` has rows: `G` times the present state, plus independent noise.
    pub fn augment(&mut self, g: &Rows, noise: &Matrix3<f64>) {
        let (n, m) = (self.n, self.n + g.rows);
        let cross = self.cross(g);
        let mut p = vec![0.0; m * m];
        for column in 0..n {
            p[column * m..][..n].copy_from_slice(&self.p[column * n..][..n]);
            for i in 0..g.rows {
                p[column * m + n + i] = cross[i * n + column];
                p[(n + i) * m + column] = cross[i * n + column];
            }
        }
        for i in 0..g.rows {
            for j in 0..=i {
                let own = 0.5 * (g.row_times(i, &cross[j * n..][..n]) + g.row_times(j, &cross[i * n..][..n]));
                p[(n + j) * m + n + i] = own + noise[(i, j)];
                p[(n + i) * m + n + j] = own + noise[(i, j)];
            }
        }
        (self.n, self.p) = (m, p);
    }

    /// Removes `size` variables from `at` on.
    pub fn remove(&mut self, at: usize, size: usize) {
        let n = self.n;
        let kept = |k: &usize| *k < at || *k >= at + size;
        let mut p = Vec::with_capacity((n - size) * (n - size));
        for column in (0..n).filter(kept) {
            let from = &self.p[column * n..][..n];
            p.extend_from_slice(&from[..at]);
            p.extend_from_slice(&from[at + size..]);
        }
        (self.n, self.p) = (n - size, p);
    }

    fn symmetrise(&mut self) {
        let n = self.n;
        for column in 0..n {
            for row in column + 1..n {
                let v = 0.5 * (self.p[column * n + row] + self.p[row * n + column]);
                self.p[column * n + row] = v;
                self.p[row * n + column] = v;
            }
        }
    }
}

/// `M H^T` for a square matrix in column-major order.
fn cross_of(m: &[f64], n: usize, h: &Rows) -> Vec<f64> {
    let mut cross = vec![0.0; n * h.rows];
    for (offset, width, values) in &h.blocks {
        for k in 0..*width {
            let column = &m[(offset + k) * n..][..n];
            for (r, to) in cross.chunks_exact_mut(n).enumerate() {
                let by = values[(r, k)];
                to.iter_mut().zip(column).for_each(|(t, c)| *t += by * c);
            }
        }
    }
    cross
}

/// `M += sign * A B^T`, where `A` and `B` have `n` rows and equally many columns.
fn add_product(m: &mut [f64], n: usize, a: &[f64], b: &[f64], sign: f64) {
    for (j, column) in m.chunks_exact_mut(n).enumerate() {
        for (a, b) in a.chunks_exact(n).zip(b.chunks_exact(n)) {
            let by = sign * b[j];
            column.iter_mut().zip(a).for_each(|(v, a)| *v += by * a);
        }
    }
}

#[cfg(test)]
mod tests;
