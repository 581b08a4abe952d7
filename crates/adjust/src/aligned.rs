//! Poses of key frames relative to each other by the depth that both have of one surface, as factors of a window.
//!
//! Two visits of a place from other viewpoints share few landmarks or none: then nothing but the surface relates them.

use crate::factor::{Frames, WindowFactors};
use crate::motion::by_both_ends;
use cairn_atlas::{KeyFrameId, RelativePose, Snapshot};
use cairn_geometry::{LieGroup, Se3};
use cairn_solve::{CHI2_95, Equations, Factors, Variable};
use nalgebra::{Matrix6, SMatrix, SymmetricEigen, Vector6};
use std::collections::BTreeMap;

/// Information that keeps directions of which nothing is known from running away on rounding errors: a standard deviation of 10 m or rad.
const LEAST_INFORMATION: f64 = 0.01;

/// One between two poses of a window.
#[derive(Clone, Debug)]
struct Link {
    from: usize,
    to: usize,
    measured: RelativePose,
    /// What whitens a residual: its square is the information.
    root: Matrix6<f64>,
    is_used: bool,
}

impl Link {
    fn chi2(&self, poses: &[Se3]) -> f64 {
        self.measured.chi2(&poses[self.from], &poses[self.to])
    }

    /// Whitened residual and its derivative by right perturbations of both ends.
    fn linear(&self, poses: &[Se3]) -> (Vector6<f64>, SMatrix<f64, 6, 12>) {
        let between = poses[self.from].inverse() * poses[self.to];
        let off = self.measured.from_from_here.inverse() * between;
        let by_to = self.root * off.coordinates_jacobian();
        (self.root * off.coordinates(), by_both_ends(by_to, &between))
    }
}

/// Huber's loss of a chi-square of six degrees of freedom, and the weight of its residual.
fn huber(chi2: f64) -> (f64, f64) {
    let bound = CHI2_95[5];
    if chi2 <= bound {
        (0.5 * chi2, 1.0)
    } else {
        ((bound * chi2).sqrt() - 0.5 * bound, (bound / chi2).sqrt())
    }
}

/// The relative poses that a map has, as factors of a window that has both ends.
#[derive(Clone, Debug, Default)]
pub struct RelativePoseFactors {
    links: Vec<Link>,
}

impl WindowFactors for RelativePoseFactors {
    fn bind(&mut self, snapshot: &Snapshot, frames: &Frames) -> usize {
        let slots: BTreeMap<KeyFrameId, usize> =
            frames.key_frames.iter().enumerate().map(|(slot, id)| (*id, slot)).collect();
        let link = |to: usize, measured: &RelativePose| {
            let (from, unit) = (*slots.get(&measured.from)?, snapshot.key_frame(measured.from)?.unit);
            let measured = measured.in_map(unit);
            let information = measured.information + Matrix6::identity() * LEAST_INFORMATION;
            let measured = RelativePose { information, ..measured };
            let link = Link { from, to, measured, root: root(&information), is_used: true };
            frames.any_moves(&[from, to]).then_some(link)
        };
        let of = |(to, id): (usize, &KeyFrameId)| {
            let all = snapshot.key_frame(*id).map_or(&[][..], |k| &k.relative_poses);
            all.iter().filter_map(|z| link(to, z)).collect::<Vec<_>>()
        };
        self.links = frames.key_frames.iter().enumerate().flat_map(of).collect();
        self.links.len()
    }
    /// Those that the poses contradict count no more.
    fn leave_out_outliers(&mut self, poses: &[Se3]) {
        for link in &mut self.links {
            link.is_used &= link.measured.agrees(&poses[link.from], &poses[link.to]);
        }
    }
}

/// The symmetric root of an information.
fn root(information: &Matrix6<f64>) -> Matrix6<f64> {
    let eigen = SymmetricEigen::new((information + information.transpose()) * 0.5);
    let values = Matrix6::from_diagonal(&eigen.eigenvalues.map(|v| v.max(0.0).sqrt()));
    eigen.eigenvectors * values * eigen.eigenvectors.transpose()
}

impl Factors for RelativePoseFactors {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.links.iter().for_each(|l| visit(&[Variable::Pose(l.from), Variable::Pose(l.to)]));
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        for l in self.links.iter().filter(|l| l.is_used) {
            let (residual, jacobian) = l.linear(poses);
            let weight = huber(l.chi2(poses)).1.sqrt();
            let parts = [(Some(Variable::Pose(l.from)), 0..6), (Some(Variable::Pose(l.to)), 6..12)];
            equations.add(&(residual * weight), &(jacobian * weight), &parts);
        }
        Some(())
    }
    fn attempt(&mut self, poses: &[Se3], _: &[f64]) -> f64 {
        self.links.iter().filter(|l| l.is_used).map(|l| huber(l.chi2(poses)).0).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Manifold, So3, Vec3};

    fn pose(k: f64) -> Se3 {
        Se3::new(
            So3::exp(&(Vec3::new((1.1 * k).sin(), (2.3 * k).sin(), (3.7 * k).sin()) * 0.6)),
            Vec3::new((1.7 * k).cos(), (0.9 * k).cos(), (2.9 * k).cos()),
        )
    }

    fn link(free: usize) -> Link {
        let from = KeyFrameId::from_index(0).expect("a number");
        let mixed = SMatrix::<f64, 6, 6>::from_fn(|i, j| (1.3 * i as f64 + 2.1 * j as f64).sin());
        let mut scales = Vector6::new(900.0, 40.0, 7.0, 300.0, 80.0, 20.0);
        scales.iter_mut().take(free).for_each(|s| *s = 0.0);
        let axes = SymmetricEigen::new(mixed + mixed.transpose()).eigenvectors;
        let information = axes * Matrix6::from_diagonal(&scales) * axes.transpose();
        let measured = RelativePose { from, from_from_here: pose(3.0), information };
        Link { from: 1, to: 0, measured, root: root(&information), is_used: true }
    }

    #[test]
    fn the_jacobian_is_that_of_the_residual_and_its_square_the_chi_square() {
        let (link, poses) = (link(0), [pose(1.0), pose(2.0)]);
        let (residual, jacobian) = link.linear(&poses);
        assert!((residual.norm_squared() / link.chi2(&poses) - 1.0).abs() < 1e-9);
        for column in 0..12 {
            let moved = |by: f64| {
                let mut moved = poses;
                let end = if column < 6 { link.from } else { link.to };
                let mut step = Vector6::zeros();
                step[column % 6] = by;
                moved[end] = moved[end].retract(&step);
                link.linear(&moved).0
            };
            let numeric = (moved(1e-5) - moved(-1e-5)) / 2e-5;
            assert!((numeric - jacobian.column(column)).norm() < 1e-4, "column {column}");
        }
    }

    #[test]
    fn a_direction_without_information_costs_nothing() {
        let link = link(1);
        let free = SymmetricEigen::new(link.measured.information);
        let (at, _) = free.eigenvalues.argmin();
        let along = free.eigenvectors.column(at) * 0.02;
        let poses = |step: Vector6<f64>| [link.measured.from_from_here.retract(&step), Se3::identity()];
        assert!(link.chi2(&poses(along)) < 1e-6);
        let (at, _) = free.eigenvalues.argmax();
        let across = poses(free.eigenvectors.column(at) * 0.4);
        assert!(!link.measured.agrees(&across[1], &across[0]));
    }
}
