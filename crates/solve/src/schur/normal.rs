//! The normal equations that factors and observations are added to.

use super::pattern::Pattern;
use cairn_geometry::{Mat3, Vec3};
use nalgebra::{SMatrix, SVector};
use std::ops::Range;
use std::sync::Arc;

/// The undamped normal equations at a state.
#[derive(Clone)]
pub struct Normal<const P: usize> {
    /// Of each free camera.
    pub cameras: Vec<SMatrix<f64, P, P>>,
    pub camera_gradients: Vec<SVector<f64, P>>,
    /// Of each point.
    pub points: Vec<Mat3>,
    pub point_gradients: Vec<Vec3>,
    pub cost: f64,
    pub pattern: Arc<Pattern>,
    /// Blocks of two cameras from factors beside points, in the order of the pattern's links.
    pub camera_links: Vec<SMatrix<f64, P, P>>,
    /// Of the further variables: gradient, diagonal blocks, and blocks with cameras and each other.
    pub more_gradient: Vec<f64>,
    pub more_diagonal: Vec<f64>,
    pub more_off: Vec<f64>,
}

impl<const P: usize> Normal<P> {
    /// Zeros again.
    pub fn clear(&mut self) {
        self.cameras.fill(SMatrix::zeros());
        self.camera_gradients.fill(SVector::zeros());
        self.points.fill(Mat3::zeros());
        self.point_gradients.fill(Vec3::zeros());
        self.camera_links.fill(SMatrix::zeros());
        self.more_gradient.fill(0.0);
        self.more_diagonal.fill(0.0);
        self.more_off.fill(0.0);
        self.cost = 0.0;
    }

    /// Adds whitened rows of a factor that touches some block rows: for each the columns of the Jacobian that are its. Rows
    /// of variables that are not free are `None`. Block rows that share a factor were announced to [`Schur::new`](super::Schur::new).
    pub fn add_factor<const R: usize, const C: usize>(
        &mut self,
        residual: &SVector<f64, R>,
        jacobian: &SMatrix<f64, R, C>,
        parts: &[(Option<usize>, Range<usize>)],
    ) {
        self.cost += 0.5 * residual.norm_squared();
        let (hessian, gradient) = (jacobian.tr_mul(jacobian), jacobian.tr_mul(residual));
        let parts = || parts.iter().filter_map(|(row, range)| Some(((*row)?, range.clone())));
        for (a, ra) in parts() {
            self.add_gradient(a, &gradient.as_slice()[ra.clone()]);
            for (b, rb) in parts().filter(|(b, _)| *b <= a) {
                let block = self.block_mut(a, b);
                for (to, c) in block.chunks_exact_mut(ra.len()).zip(rb) {
                    to.iter_mut().zip(ra.clone()).for_each(|(t, r)| *t += hessian[(r, c)]);
                }
            }
        }
    }

    fn add_gradient(&mut self, row: usize, gradient: &[f64]) {
        let to = match self.camera_gradients.get_mut(row) {
            Some(camera) => camera.as_mut_slice(),
            None => &mut self.more_gradient[self.pattern.gradient_start(row)..],
        };
        to.iter_mut().zip(gradient).for_each(|(t, g)| *t += g);
    }

    /// The block of two rows, the first not of lower place, by columns.
    fn block_mut(&mut self, a: usize, b: usize) -> &mut [f64] {
        let pattern = &self.pattern;
        if a == b {
            return match self.cameras.get_mut(a) {
                Some(camera) => camera.as_mut_slice(),
                None => {
                    let k = a - pattern.cameras;
                    &mut self.more_diagonal[pattern.diagonal_start[k]..pattern.diagonal_start[k + 1]]
                }
            };
        }
        let pair = pattern.pair(a, b);
        match pair.checked_sub(pattern.camera_pairs) {
            Some(k) => &mut self.more_off[pattern.off_start[k]..pattern.off_start[k + 1]],
            None => {
                let link = pattern.camera_links.partition_point(|p| (*p as usize) < pair);
                self.camera_links[link].as_mut_slice()
            }
        }
    }
}
