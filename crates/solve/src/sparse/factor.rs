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

/// The matrix is not positive definite, or has an entry that is not finite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotPositive;

/// The blocks of a matrix to be factored, each column-major.
pub trait Blocks {
    /// The diagonal block of a row; only its lower triangle is read.
    fn diagonal(&self, row: usize) -> &[f64];
    /// The block of [`Analysis::pairs`] with this index.
    fn off_diagonal(&self, pair: usize) -> &[f64];
}

/// Blocks of one size that follow each other in memory.
#[derive(Clone, Copy, Debug)]
pub struct UniformBlocks<'a> {
    /// Scalar rows of a block.
    pub size: usize,
    /// Diagonal blocks.
    pub diagonal: &'a [f64],
    /// The others, in the order of [`Analysis::pairs`].
    pub off_diagonal: &'a [f64],
}

impl Blocks for UniformBlocks<'_> {
    fn diagonal(&self, row: usize) -> &[f64] {
        &self.diagonal[row * self.size * self.size..][..self.size * self.size]
    }

    fn off_diagonal(&self, pair: usize) -> &[f64] {
        &self.off_diagonal[pair * self.size * self.size..][..self.size * self.size]
    }
}

impl Factor {
    /// Room for a factor of matrices with this pattern.
    pub fn new(analysis: Arc<Analysis>) -> Self {
        let panels = analysis.supernodes.iter().map(|s| vec![0.0; s.height() * s.columns()]).collect();
        let updates = vec![Vec::new(); analysis.supernodes.len()];
        Self { analysis, panels, updates, spare: Vec::new() }
    }

    /// The pattern.
    pub fn analysis(&self) -> &Arc<Analysis> {
        &self.analysis
    }

    /// Factors a matrix with this pattern.
    ///
    /// # Errors
    /// When the matrix is not positive definite; the factor is of no use then until the next success.
    ///
    /// # Panics
    /// When blocks do not have the sizes of the pattern.
    pub fn factor(&mut self, blocks: &impl Blocks) -> Result<(), NotPositive> {
        let analysis = Arc::clone(&self.analysis);
        for (k, s) in analysis.supernodes.iter().enumerate() {
            let (m, width) = (s.height(), s.columns());
            let below = m - width;
            let mut update = self.spare.pop().unwrap_or_default();
            update.clear();
            update.resize(below * below, 0.0);
            let mut front = Front { panel: &mut self.panels[k], rest: &mut update, m, width };
            front.panel.fill(0.0);
            front.gather(s, blocks);
            for &child in &s.children {
                let given = std::mem::take(&mut self.updates[child as usize]);
                front.add(s, &analysis.supernodes[child as usize], &given);
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
        let a = &*self.analysis;
        let mut y = vec![0.0; x.len()];
        for (i, p) in a.place.iter().enumerate() {
            y[a.start[*p as usize]..][..a.sizes[i]].copy_from_slice(&x[a.offset[i]..a.offset[i + 1]]);
        }
        let mut local = Vec::new();
        for (s, panel) in a.supernodes.iter().zip(&self.panels) {
            forward(s, panel, &a.start, &mut y, &mut local);
        }
        for (s, panel) in a.supernodes.iter().zip(&self.panels).rev() {
            backward(s, panel, &a.start, &mut y, &mut local);
        }
        for (i, p) in a.place.iter().enumerate() {
            x[a.offset[i]..a.offset[i + 1]].copy_from_slice(&y[a.start[*p as usize]..][..a.sizes[i]]);
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
    fn gather(&mut self, s: &Supernode, blocks: &impl Blocks) {
        for (k, row) in s.diagonal.iter().enumerate() {
            let first = s.row_start[k];
            let d = s.row_start[k + 1] - first;
            for (c, column) in blocks.diagonal(*row as usize).chunks_exact(d).enumerate() {
                self.panel[(first + c) * self.m + first..][..d].copy_from_slice(column);
            }
        }
        for &(index, row, column, transposed) in &s.off_diagonal {
            let block = blocks.off_diagonal(index as usize);
            let (top, left) = (s.row_start[row as usize], s.row_start[column as usize]);
            let height = s.row_start[row as usize + 1] - top;
            let width = s.row_start[column as usize + 1] - left;
            for c in 0..width {
                let to = &mut self.panel[(left + c) * self.m + top..][..height];
                if transposed {
                    to.iter_mut().enumerate().for_each(|(r, v)| *v = block[r * width + c]);
                } else {
                    to.copy_from_slice(&block[c * height..(c + 1) * height]);
                }
            }
        }
    }

    /// Adds what a child left over; `s` is the supernode of this front.
    fn add(&mut self, s: &Supernode, child: &Supernode, given: &[f64]) {
        // Runs of rows that stay neighbours: (first scalar row in the child's rest, row in the front, length).
        let mut runs: Vec<(usize, usize, usize)> = Vec::new();
        for (i, into) in child.into_parent.iter().enumerate() {
            let first = child.row_start[child.width + i] - child.columns();
            let (to, d) =
                (s.row_start[*into as usize], child.row_start[child.width + i + 1] - child.columns() - first);
            match runs.last_mut() {
                Some((_, start, len)) if *start + *len == to => *len += d,
                _ => runs.push((first, to, d)),
            }
        }
        let ld = child.height() - child.columns();
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
                // Within the run itself, from the diagonal on.
                let own = (first_column + c, column, columns - c);
                for &(row, to, len) in std::iter::once(&own).chain(&runs[k + 1..]) {
                    let (from, to) = (&from[row..row + len], &mut target[to - offset..to - offset + len]);
                    to.iter_mut().zip(from).for_each(|(t, f)| *t += f);
                }
            }
        }
    }
}

fn forward(s: &Supernode, panel: &[f64], start: &[usize], y: &mut [f64], local: &mut Vec<f64>) {
    let (m, width) = (s.height(), s.columns());
    let first = start[s.first];
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
    for (k, row) in s.rows.iter().enumerate().skip(s.width) {
        let part = &local[s.row_start[k]..s.row_start[k + 1]];
        y[start[*row as usize]..].iter_mut().zip(part).for_each(|(y, p)| *y += p);
    }
}

fn backward(s: &Supernode, panel: &[f64], start: &[usize], y: &mut [f64], local: &mut Vec<f64>) {
    let (m, width) = (s.height(), s.columns());
    local.clear();
    for row in &s.rows {
        local.extend_from_slice(&y[start[*row as usize]..start[*row as usize + 1]]);
    }
    for j in (0..width).rev() {
        let column = &panel[j * m + j..(j + 1) * m];
        local[j] = (local[j] - dot(&column[1..], &local[j + 1..])) / column[0];
    }
    let first = start[s.first];
    y[first..first + width].copy_from_slice(&local[..width]);
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

    /// Blocks stored separately.
    struct Scattered {
        diagonal: Vec<Vec<f64>>,
        off: Vec<Vec<f64>>,
    }

    impl Blocks for Scattered {
        fn diagonal(&self, row: usize) -> &[f64] {
            &self.diagonal[row]
        }
        fn off_diagonal(&self, pair: usize) -> &[f64] {
            &self.off[pair]
        }
    }

    /// A diagonally dominant matrix with this pattern: blocks and, as a whole, dense.
    fn matrix(analysis: &Analysis) -> (Scattered, DMatrix<f64>) {
        let n = analysis.dimension();
        let mut dense = DMatrix::zeros(n, n);
        let mut off = Vec::new();
        for (k, &(a, b)) in analysis.pairs().iter().enumerate() {
            let (a, b) = (a as usize, b as usize);
            let mut block = Vec::new();
            for c in 0..analysis.size(b) {
                for r in 0..analysis.size(a) {
                    let v = ((k * 31 + c * 7 + r * 3) as f64).sin();
                    block.push(v);
                    dense[(analysis.offset(a) + r, analysis.offset(b) + c)] = v;
                    dense[(analysis.offset(b) + c, analysis.offset(a) + r)] = v;
                }
            }
            off.push(block);
        }
        for i in 0..n {
            dense[(i, i)] = 1.0 + dense.row(i).iter().map(|v| v.abs()).sum::<f64>();
        }
        let block = |i: usize| {
            let (at, d) = (analysis.offset(i), analysis.size(i));
            dense.view((at, at), (d, d)).iter().copied().collect()
        };
        let diagonal = (0..analysis.rows()).map(block).collect();
        (Scattered { diagonal, off }, dense)
    }

    /// A chain with far jumps, as graphs of poses are.
    fn pairs(n: usize) -> Vec<(usize, usize)> {
        let mut pairs: Vec<_> = (1..n).map(|i| (i - 1, i)).collect();
        pairs.extend((0..n / 2).map(|k| ((k * 17) % n, (k * 29 + 5) % n)));
        pairs
    }

    fn check(analysis: Analysis) {
        let analysis = Arc::new(analysis);
        let (blocks, dense) = matrix(&analysis);
        let b: Vec<f64> = (0..analysis.dimension()).map(|i| (i as f64 * 0.37).cos()).collect();
        let expected = dense.cholesky().expect("dominant").solve(&DVector::from_vec(b.clone()));
        let mut factor = Factor::new(analysis);
        // Twice: the second uses the memory of the first.
        for _ in 0..2 {
            factor.factor(&blocks).expect("dominant");
            let mut x = b.clone();
            factor.solve(&mut x);
            assert!((DVector::from_vec(x) - &expected).norm() < 1e-10);
        }
    }

    #[test]
    fn agrees_with_dense_cholesky() {
        for (n, d) in [(1, 6), (2, 3), (9, 1), (40, 6), (60, 3), (35, 7), (25, 9), (120, 2)] {
            check(Analysis::new(n, d, pairs(n).into_iter()));
        }
    }

    #[test]
    fn agrees_with_dense_cholesky_for_blocks_of_different_sizes() {
        for n in [2, 7, 30, 61] {
            let sizes = (0..n).map(|i| [6, 9, 1, 6, 3][i % 5]).collect();
            check(Analysis::with_sizes(sizes, pairs(n).into_iter()));
        }
    }

    #[test]
    fn indefinite_matrix_is_refused_and_the_factor_stays_usable() {
        let analysis = Arc::new(Analysis::new(40, 3, pairs(40).into_iter()));
        let (mut blocks, _) = matrix(&analysis);
        let mut factor = Factor::new(analysis);
        for bad in [-1.0, f64::NAN] {
            let good = std::mem::replace(&mut blocks.diagonal[17][0], bad);
            assert_eq!(factor.factor(&blocks), Err(NotPositive));
            blocks.diagonal[17][0] = good;
            assert_eq!(factor.factor(&blocks), Ok(()));
        }
    }
}
