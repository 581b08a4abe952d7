//! A start that does not depend on one: rotations by linear least squares over matrices, then translations.
//!
//! Source: Carlone, Tron, Daniilidis, Dellaert, "Initialization techniques for 3D SLAM: a survey on rotation estimation
//! and its use in pose graph optimization" (2015), section III.C (chordal relaxation; Martinec and Pajdla, 2007).

use super::{Edge, PoseGraph};
use crate::sparse::{Analysis, Factor, NotPositive, UniformBlocks};
use cairn_geometry::{LieGroup, Mat3, Se2, Se3, So2, So3, Vec2, Vec3};
use nalgebra::SMatrix;
use std::sync::Arc;

/// A group of rigid transforms, viewed as transforms of space.
pub trait Rigid<const D: usize>: LieGroup<D> {
    /// The rotation matrix and the translation, metres.
    fn to_space(&self) -> (Mat3, Vec3);
    /// The element nearest to them.
    fn from_space(rotation: &Mat3, translation: &Vec3) -> Self;
    /// SE-Sync's weights `tau` of translation and `kappa` of rotation for an information matrix (Rosen et al., "SE-Sync",
    /// 2019, problem 1, as its authors read g2o files).
    fn weights(information: &SMatrix<f64, D, D>) -> (f64, f64);
    /// The isotropic information with which twice the chordal cost is SE-Sync's objective,
    /// `sum kappa |R_b - R_a R_ab|^2 + tau |t_b - t_a - R_a t_ab|^2` in Frobenius norms.
    fn isotropic(information: &SMatrix<f64, D, D>) -> SMatrix<f64, D, D>;
}

impl Rigid<6> for Se3 {
    fn to_space(&self) -> (Mat3, Vec3) {
        (self.rotation.matrix(), self.translation)
    }
    fn from_space(rotation: &Mat3, translation: &Vec3) -> Self {
        Self::new(So3::from_matrix(rotation), *translation)
    }
    fn weights(information: &SMatrix<f64, 6, 6>) -> (f64, f64) {
        let block = |k| information.fixed_view::<3, 3>(k, k).into_owned();
        let weight = |m: Mat3| m.try_inverse().map_or(0.0, |c| 3.0 / c.trace());
        (weight(block(0)), 0.5 * weight(block(3)))
    }
    fn isotropic(information: &SMatrix<f64, 6, 6>) -> SMatrix<f64, 6, 6> {
        let (tau, kappa) = Self::weights(information);
        // The chord is half a Frobenius norm.
        let diagonal = [tau, tau, tau, 2.0 * kappa, 2.0 * kappa, 2.0 * kappa];
        SMatrix::from_diagonal(&diagonal.into())
    }
}

impl Rigid<3> for Se2 {
    fn to_space(&self) -> (Mat3, Vec3) {
        let (c, s) = (self.rotation.cos(), self.rotation.sin());
        (
            Mat3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0),
            Vec3::new(self.translation.x, self.translation.y, 0.0),
        )
    }
    fn from_space(m: &Mat3, t: &Vec3) -> Self {
        let rotation = So2::from_cos_sin(m[(0, 0)] + m[(1, 1)], m[(1, 0)] - m[(0, 1)]);
        Self::new(rotation.unwrap_or(So2::identity()), Vec2::new(t.x, t.y))
    }
    fn weights(information: &SMatrix<f64, 3, 3>) -> (f64, f64) {
        let translation = information.fixed_view::<2, 2>(0, 0).into_owned().try_inverse();
        (translation.map_or(0.0, |c| 2.0 / c.trace()), information[(2, 2)])
    }
    fn isotropic(information: &SMatrix<f64, 3, 3>) -> SMatrix<f64, 3, 3> {
        let (tau, kappa) = Self::weights(information);
        SMatrix::from_diagonal(&[tau, tau, 2.0 * kappa].into())
    }
}

/// Sets every vertex that is not held: rotations by the chordal relaxation, translations by least squares given those.
/// Held vertices stay where they are. Of a condensed part, each pose relative to the first counts as a measurement with its
/// marginal information.
///
/// # Errors
/// When the edges do not connect every vertex to a held one with weights for rotation and translation; nothing is
/// changed then.
pub fn chordal_start<G: Rigid<D>, const D: usize>(graph: &mut PoseGraph<G, D>) -> Result<(), NotPositive> {
    let held = graph.held();
    let stars: Vec<Edge<G, D>> = graph.condensed.iter().flat_map(|c| c.star()).collect();
    let edges: Vec<Measured> = graph
        .edges
        .iter()
        .chain(&stars)
        .map(|e| {
            let (rotation, translation) = e.a_from_b.to_space();
            let weights = G::weights(&e.information);
            Measured { a: e.a, b: e.b, rotation, translation, weights }
        })
        .collect();
    let mut poses: Vec<(Mat3, Vec3)> = graph.values.iter().map(|v| v.to_space()).collect();
    let free: Vec<usize> = (0..held.len()).filter(|i| !held[*i]).collect();
    let mut slot = vec![None; held.len()];
    free.iter().enumerate().for_each(|(k, i)| slot[*i] = Some(k));
    // What no edge gives a rotation keeps its own: points, say.
    let mut turned = vec![false; held.len()];
    edges.iter().filter(|e| e.weights.1 > 0.0).for_each(|e| (turned[e.a], turned[e.b]) = (true, true));
    let turning: Vec<usize> = free.iter().copied().filter(|i| turned[*i]).collect();
    let mut turning_slot = vec![None; held.len()];
    turning.iter().enumerate().for_each(|(k, i)| turning_slot[*i] = Some(k));
    rotations(&mut poses, &edges, &turning, &turning_slot)?;
    translations(&mut poses, &edges, &free, &slot)?;
    for i in free {
        graph.values[i] = G::from_space(&poses[i].0, &poses[i].1);
    }
    Ok(())
}

struct Measured {
    a: usize,
    b: usize,
    rotation: Mat3,
    translation: Vec3,
    weights: (f64, f64),
}

/// A system over the free vertices, ready to be solved: of each edge the weight of both ends, and the block in the row of
/// its second vertex and the column of its first.
fn system<const N: usize>(
    edges: &[Measured],
    free: usize,
    slot: &[Option<usize>],
    block: impl Fn(&Measured) -> (f64, SMatrix<f64, N, N>),
) -> Result<Factor, NotPositive> {
    let pairs = edges.iter().filter_map(|e| Some((slot[e.a]?, slot[e.b]?)));
    let analysis = Arc::new(Analysis::new(free, N, pairs));
    let mut diagonal = vec![SMatrix::<f64, N, N>::zeros(); free];
    let mut off = vec![SMatrix::<f64, N, N>::zeros(); analysis.pairs().len()];
    for e in edges {
        let (weight, block) = block(e);
        for (end, other, block) in [(e.b, e.a, block), (e.a, e.b, block.transpose())] {
            let Some(s) = slot[end] else { continue };
            diagonal[s] += SMatrix::from_diagonal_element(weight);
            if let Some(pair) = slot[other].filter(|t| s > *t).and_then(|t| analysis.pair(s, t)) {
                off[pair] += block;
            }
        }
    }
    let numbers = |blocks: &[SMatrix<f64, N, N>]| -> Vec<f64> {
        blocks.iter().flat_map(|b| b.iter().copied()).collect()
    };
    let mut factor = Factor::new(analysis);
    let (diagonal, off) = (numbers(&diagonal), numbers(&off));
    factor.factor(&UniformBlocks { size: N, diagonal: &diagonal, off_diagonal: &off })?;
    Ok(factor)
}

/// `min sum k |R_b - R_a R_ab|^2` over matrices: the three rows of all rotations have one system with blocks of three.
fn rotations(
    poses: &mut [(Mat3, Vec3)],
    edges: &[Measured],
    free: &[usize],
    slot: &[Option<usize>],
) -> Result<(), NotPositive> {
    // With rows as columns x = R^T: x_b - R_ab^T x_a.
    let block = |e: &Measured| e.rotation.transpose() * -e.weights.1;
    let factor = system(edges, free.len(), slot, |e| (e.weights.1, block(e)))?;
    // Column r of a right side belongs to row r of the rotations.
    let mut sides = vec![vec![Vec3::zeros(); free.len()]; 3];
    for e in edges {
        let m = block(e);
        for (end, other, m) in [(e.b, e.a, m), (e.a, e.b, m.transpose())] {
            if let (Some(s), None) = (slot[end], slot[other]) {
                for (r, side) in sides.iter_mut().enumerate() {
                    side[s] -= m * poses[other].0.row(r).transpose();
                }
            }
        }
    }
    for (r, side) in sides.iter().enumerate() {
        let mut x: Vec<f64> = side.iter().flat_map(|v| [v.x, v.y, v.z]).collect();
        factor.solve(&mut x);
        for (i, row) in free.iter().zip(x.chunks_exact(3)) {
            poses[*i].0.set_row(r, &nalgebra::RowVector3::from_row_slice(row));
        }
    }
    for i in free {
        poses[*i].0 = So3::from_matrix(&poses[*i].0).matrix();
    }
    Ok(())
}

/// `min sum w |t_b - t_a - R_a t_ab|^2`: one scalar system for x, y and z.
fn translations(
    poses: &mut [(Mat3, Vec3)],
    edges: &[Measured],
    free: &[usize],
    slot: &[Option<usize>],
) -> Result<(), NotPositive> {
    let factor = system(edges, free.len(), slot, |e| {
        let w = e.weights.0;
        (w, SMatrix::<f64, 1, 1>::new(-w))
    })?;
    let mut sides = vec![vec![0.0; free.len()]; 3];
    for e in edges {
        let moved = poses[e.a].0 * e.translation;
        for (end, other, mut known) in [(e.b, e.a, moved), (e.a, e.b, -moved)] {
            let Some(s) = slot[end] else { continue };
            if slot[other].is_none() {
                known += poses[other].1;
            }
            (0..3).for_each(|r| sides[r][s] += e.weights.0 * known[r]);
        }
    }
    for (r, side) in sides.iter_mut().enumerate() {
        factor.solve(side);
        free.iter().zip(side.iter()).for_each(|(i, v)| poses[*i].1[r] = *v);
    }
    Ok(())
}
