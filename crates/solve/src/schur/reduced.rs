//! The reduced system: what is left when the points are eliminated.

use super::pattern::Pattern;
use crate::sparse::Blocks;
use nalgebra::SMatrix;
use std::ops::Range;
use std::sync::Arc;

/// The reduced, damped system.
pub struct Reduced<const P: usize> {
    pub pattern: Arc<Pattern>,
    pub diagonal: Vec<SMatrix<f64, P, P>>,
    pub off: Vec<SMatrix<f64, P, P>>,
    pub more_diagonal: Vec<f64>,
    pub more_off: Vec<f64>,
}

impl<const P: usize> Blocks for Reduced<P> {
    fn diagonal(&self, row: usize) -> &[f64] {
        match self.diagonal.get(row) {
            Some(block) => block.as_slice(),
            None => {
                let k = row - self.pattern.cameras;
                &self.more_diagonal[self.pattern.diagonal_start[k]..self.pattern.diagonal_start[k + 1]]
            }
        }
    }

    fn off_diagonal(&self, pair: usize) -> &[f64] {
        match self.off.get(pair) {
            Some(block) => block.as_slice(),
            None => {
                let k = pair - self.pattern.camera_pairs;
                &self.more_off[self.pattern.off_start[k]..self.pattern.off_start[k + 1]]
            }
        }
    }
}

impl<const P: usize> Reduced<P> {
    /// Takes components of a variable out of the system: their step is zero.
    pub fn hold(&mut self, row: usize, components: &Range<usize>, right: &mut [f64]) {
        let pattern = Arc::clone(&self.pattern);
        let analysis = &pattern.analysis;
        let d = analysis.size(row);
        let own = match self.diagonal.get_mut(row) {
            Some(block) => block.as_mut_slice(),
            None => &mut self.more_diagonal[pattern.diagonal_start[row - pattern.cameras]..][..d * d],
        };
        for k in components.clone() {
            for other in 0..d {
                own[k * d + other] = 0.0;
                own[other * d + k] = 0.0;
            }
            own[k * d + k] = 1.0;
            right[analysis.offset(row) + k] = 0.0;
        }
        for (pair, (a, b)) in analysis.pairs().iter().enumerate() {
            let (a, b) = (*a as usize, *b as usize);
            if a != row && b != row {
                continue;
            }
            let block = match self.off.get_mut(pair) {
                Some(block) => block.as_mut_slice(),
                None => {
                    let k = pair - pattern.camera_pairs;
                    &mut self.more_off[pattern.off_start[k]..pattern.off_start[k + 1]]
                }
            };
            let height = analysis.size(a);
            for k in components.clone() {
                if a == row {
                    block.iter_mut().skip(k).step_by(height).for_each(|v| *v = 0.0);
                } else {
                    block[k * height..(k + 1) * height].fill(0.0);
                }
            }
        }
    }
}
