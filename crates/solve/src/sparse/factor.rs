//! The numbers of a factorisation: fronts from the leaves to the roots, then triangular solves.
//!
//! Source: Liu, "The multifrontal method for sparse matrix solution: theory and practice" (1992).

use super::dense::factor_front;
use super::symbolic::{Analysis, Supernode};
use std::sync::Arc;

/// A lower triangular factor `L` with `L L^T` the matrix.
#[derive(Clone, Debug)]
pub struct Factor {
    analysis: Arc<Analysis>,
    /// Per supernode its columns, column-major, with as many rows as its front.
    panels: Vec<Vec<f64>>,
    /// What fronts hand to their parents; empty between factorisations but for its memory.
    updates: Vec<Vec<f64>>,
    spare: Vec<Vec<f64>>,
}

/// The matrix is not positive definite, or holds what is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotPositive;

impl Factor {
    /// Room for a factor of matrices with this pattern.
    pub fn new(analysis: Arc<Analysis>) -> Self {
        let d = analysis.size;
        let panels = analysis.supernodes.iter().map(|s| vec![0.0; s.rows.len() * s.width * d * d]).collect();
        let updates = vec![Vec::new(); analysis.supernodes.len()];
        Self { analysis, panels, updates, spare: Vec::new() }
    }

    /// The pattern.
    pub fn analysis(&self) -> &Arc<Analysis> {
        &self.analysis
    }

    /// Factors the matrix whose diagonal blocks are `diagonal`, and whose other blocks stand in the order of
    /// [`Analysis::pairs`], each column-major. Of the diagonal blocks the lower triangle is read.
    ///
    /// # Errors
    /// When the matrix is not positive definite; the factor is of no use then until the next success.
    ///
    /// # Panics
    /// When the slices are too short for the pattern.
    pub fn factor(&mut self, diagonal: &[f64], off_diagonal: &[f64]) -> Result<(), NotPositive> {
        let analysis = Arc::clone(&self.analysis);
        let d = analysis.size;
        for (k, s) in analysis.supernodes.iter().enumerate() {
            let (m, width) = (s.rows.len() * d, s.width * d);
            let below = m - width;
            let mut update = self.spare.pop().unwrap_or_default();
            update.clear();
            update.resize(below * below, 0.0);
            let mut front = Front { panel: &mut self.panels[k], rest: &mut update, m, width };
            front.panel.fill(0.0);
            front.gather(s, d, diagonal, off_diagonal);
            for &child in &s.children {
                let given = std::mem::take(&mut self.updates[child as usize]);
                front.add(&analysis.supernodes[child as usize].into_parent, d, &given);
                self.spare.push(given);
            }
            if !factor_front(front.panel, front.rest, m, width) {
                self.spare.push(update);
                self.spare.extend(self.updates.iter_mut().map(std::mem::take).filter(|u| u.capacity() > 0));
                return Err(NotPositive);
            }
            self.updates[k] = update;
        }
        Ok(())
    }

    /// Solves `L L^T x = b`; `x` holds `b` before, block rows in the caller's numbering.
    ///
    /// # Panics
    /// When `x` is not as long as the matrix.
    pub fn solve(&self, x: &mut [f64]) {
        let (d, place) = (self.analysis.size, &self.analysis.place);
        let mut y = vec![0.0; x.len()];
        for (i, p) in place.iter().enumerate() {
            y[*p as usize * d..][..d].copy_from_slice(&x[i * d..(i + 1) * d]);
        }
        let mut local = Vec::new();
        for (s, panel) in self.analysis.supernodes.iter().zip(&self.panels) {
            forward(s, panel, d, &mut y, &mut local);
        }
        for (s, panel) in self.analysis.supernodes.iter().zip(&self.panels).rev() {
            backward(s, panel, d, &mut y, &mut local);
        }
        for (i, p) in place.iter().enumerate() {
            x[i * d..(i + 1) * d].copy_from_slice(&y[*p as usize * d..][..d]);
        }
    }
}

/// A front while it is put together: its columns, and the square below them.
struct Front<'a> {
    panel: &'a mut [f64],
    rest: &'a mut [f64],
    m: usize,
    width: usize,
}

impl Front<'_> {
    /// Copies the matrix's own blocks in.
    fn gather(&mut self, s: &Supernode, d: usize, diagonal: &[f64], off_diagonal: &[f64]) {
        for (k, row) in s.diagonal.iter().enumerate() {
            let block = &diagonal[*row as usize * d * d..][..d * d];
            for c in 0..d {
                let at = (k * d + c) * self.m + k * d;
                self.panel[at..at + d].copy_from_slice(&block[c * d..(c + 1) * d]);
            }
        }
        for &(index, row, column, transposed) in &s.off_diagonal {
            let block = &off_diagonal[index as usize * d * d..][..d * d];
            for c in 0..d {
                let at = (column as usize * d + c) * self.m + row as usize * d;
                let to = &mut self.panel[at..at + d];
                if transposed {
                    to.iter_mut().enumerate().for_each(|(r, v)| *v = block[r * d + c]);
                } else {
                    to.copy_from_slice(&block[c * d..(c + 1) * d]);
                }
            }
        }
    }

    /// Adds what a child left, its block row `i` at block row `into[i]`.
    fn add(&mut self, into: &[u32], d: usize, given: &[f64]) {
        // Runs of rows that stay neighbours: (first row, row in the front, length), in numbers.
        let mut runs: Vec<(usize, usize, usize)> = Vec::new();
        for (i, to) in into.iter().map(|to| *to as usize * d).enumerate() {
            match runs.last_mut() {
                Some((_, start, len)) if *start + *len == to => *len += d,
                _ => runs.push((i * d, to, d)),
            }
        }
        let ld = into.len() * d;
        let rest_ld = self.m - self.width;
        for (k, &(first_column, to_column, columns)) in runs.iter().enumerate() {
            for c in 0..columns {
                let from = &given[(first_column + c) * ld..(first_column + c + 1) * ld];
                let column = to_column + c;
                let (target, offset) = if column < self.width {
                    (&mut self.panel[column * self.m..(column + 1) * self.m], 0)
                } else {
                    let start = (column - self.width) * rest_ld;
                    (&mut self.rest[start..start + rest_ld], self.width)
                };
                // In the diagonal block of the run, from the diagonal on.
                let first = c / d * d;
                let own = (first_column + first, to_column + first, columns - first);
                for &(row, to, len) in std::iter::once(&own).chain(&runs[k + 1..]) {
                    let (from, to) = (&from[row..row + len], &mut target[to - offset..to - offset + len]);
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
                }
            }
        }
    }
}

fn forward(s: &Supernode, panel: &[f64], d: usize, y: &mut [f64], local: &mut Vec<f64>) {
    let (m, width) = (s.rows.len() * d, s.width * d);
    let first = s.first * d;
    local.clear();
    local.resize(m, 0.0);
    local[..width].copy_from_slice(&y[first..first + width]);
    for j in 0..width {
        let column = &panel[j * m + j..(j + 1) * m];
        let v = local[j] / column[0];
        local[j] = v;
        local[j + 1..].iter_mut().zip(&column[1..]).for_each(|(y, l)| *y -= l * v);
    }
    y[first..first + width].copy_from_slice(&local[..width]);
    for (row, part) in s.rows[s.width..].iter().zip(local[width..].chunks_exact(d)) {
        y[*row as usize * d..][..d].iter_mut().zip(part).for_each(|(y, p)| *y += p);
    }
}

fn backward(s: &Supernode, panel: &[f64], d: usize, y: &mut [f64], local: &mut Vec<f64>) {
    let (m, width) = (s.rows.len() * d, s.width * d);
    local.clear();
    for row in &s.rows {
        local.extend_from_slice(&y[*row as usize * d..][..d]);
    }
    for j in (0..width).rev() {
        let column = &panel[j * m + j..(j + 1) * m];
        local[j] = (local[j] - dot(&column[1..], &local[j + 1..])) / column[0];
    }
    y[s.first * d..s.first * d + width].copy_from_slice(&local[..width]);
}

/// The scalar product, summed in eight lanes.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; 8];
    let (a_chunks, b_chunks) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest: f64 = a_chunks.remainder().iter().zip(b_chunks.remainder()).map(|(x, y)| x * y).sum();
    for (x, y) in a_chunks.zip(b_chunks) {
        for k in 0..8 {
            lanes[k] += x[k] * y[k];
        }
    }
    lanes.iter().sum::<f64>() + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// A diagonally dominant matrix with this pattern: blocks and, as a whole, dense.
    fn matrix(analysis: &Analysis) -> (Vec<f64>, Vec<f64>, DMatrix<f64>) {
        let (n, d) = (analysis.rows(), analysis.block_size());
        let mut dense = DMatrix::zeros(n * d, n * d);
        let mut off = Vec::new();
        for (k, &(a, b)) in analysis.pairs().iter().enumerate() {
            for c in 0..d {
                for r in 0..d {
                    let v = ((k * 31 + c * 7 + r * 3) as f64).sin();
                    off.push(v);
                    dense[(a as usize * d + r, b as usize * d + c)] = v;
                    dense[(b as usize * d + c, a as usize * d + r)] = v;
                }
            }
        }
        for i in 0..n * d {
            dense[(i, i)] = 1.0 + dense.row(i).iter().map(|v| v.abs()).sum::<f64>();
        }
        let mut diagonal = Vec::new();
        for i in 0..n {
            diagonal.extend(dense.view((i * d, i * d), (d, d)).iter());
        }
        (diagonal, off, dense)
    }

    /// A chain with far jumps, as graphs of poses are.
    fn pairs(n: usize) -> Vec<(usize, usize)> {
        let mut pairs: Vec<_> = (1..n).map(|i| (i - 1, i)).collect();
        pairs.extend((0..n / 2).map(|k| ((k * 17) % n, (k * 29 + 5) % n)));
        pairs
    }

    #[test]
    fn solves_what_dense_cholesky_solves() {
        for (n, d) in [(1, 6), (2, 3), (9, 1), (40, 6), (60, 3), (35, 7), (25, 9), (120, 2)] {
            let analysis = Arc::new(Analysis::new(n, d, pairs(n).into_iter()));
            let (diagonal, off, dense) = matrix(&analysis);
            let mut factor = Factor::new(analysis);
            let b: Vec<f64> = (0..n * d).map(|i| (i as f64 * 0.37).cos()).collect();
            let expected = dense.cholesky().expect("dominant").solve(&DVector::from_vec(b.clone()));
            // Twice: the second uses the memory of the first.
            for _ in 0..2 {
                factor.factor(&diagonal, &off).expect("dominant");
                let mut x = b.clone();
                factor.solve(&mut x);
                assert!((DVector::from_vec(x) - &expected).norm() < 1e-10, "{n} {d}");
            }
        }
    }

    #[test]
    fn what_is_not_positive_is_told_and_done_with() {
        let analysis = Arc::new(Analysis::new(40, 3, pairs(40).into_iter()));
        let (diagonal, off, _) = matrix(&analysis);
        let mut factor = Factor::new(analysis);
        for bad in [-1.0, f64::NAN] {
            let mut broken = diagonal.clone();
            broken[17 * 9] = bad;
            assert_eq!(factor.factor(&broken, &off), Err(NotPositive));
            assert_eq!(factor.factor(&diagonal, &off), Ok(()));
        }
    }
}
