//! Delayed initialisation of landmarks that one measurement does not determine: ranges or bearings are stored, each
//! with the pose it was taken from, until together they determine the position of the landmark.
//!
//! The poses are kept in the state (stochastic cloning, Roumeliotis and Burdick 2002), so that the landmark gets its
//! true correlations: the measurements are rotated so that two rows determine the landmark and initialise it, and the
//! other rows correct the state (the nullspace projection of Mourikis and Roumeliotis 2007, equations 23-24). The two
//! mirrored solutions of ranges along a line are distinguished by their likelihoods, in which the poses are as uncertain
//! as they are: a straight line that is believed to bend a little must not decide. Until that is possible, the landmark
//! waits.

use super::active::Place;
use crate::measure::{Kind, Measurement, jacobians};
use cairn_geometry::Vec2;
use cairn_solve::{Convergence, Damping, DenseNormal, LevenbergMarquardt, minimise_dense};
use nalgebra::{DMatrix, DVector, Matrix2, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Greatest number of measurements stored per landmark; beyond it, the one nearest to its neighbour is dropped, so that
/// the baseline grows.
pub(super) const MOST: usize = 12;
/// The second best position must be less likely by this much (twice the log likelihood ratio: about 1 in 400).
pub(super) const MARGIN: f64 = 12.0;
/// Number of directions, and of depths, from which the search for a position starts.
const STARTS: usize = 24;

/// A pose kept in the state for the measurements taken from it.
#[derive(Clone, Debug)]
pub(super) struct Kept {
    pub place: Place,
    pub robot: usize,
    pub travelled_m: f64,
    pub moves: usize,
}

/// Landmarks that are not initialised yet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Delayed {
    pub poses: BTreeMap<u32, Kept>,
    pub next: u32,
    pub waiting: BTreeMap<u32, Vec<(u32, Measurement)>>,
}

impl Delayed {
    pub fn places_mut(&mut self) -> impl Iterator<Item = &mut Place> {
        self.poses.values_mut().map(|k| &mut k.place)
    }

    /// Drops all waiting measurements and one pose; returns the place of the pose, which the caller must remove.
    pub fn give_up(&mut self) -> Option<Place> {
        self.waiting.clear();
        self.poses.pop_first().map(|(_, kept)| kept.place)
    }

    /// A pose that no waiting measurement uses any more.
    pub fn unused(&mut self) -> Option<Place> {
        let used = |key: &u32| self.waiting.values().flatten().any(|(k, _)| k == key);
        let key = *self.poses.keys().find(|key| !used(key))?;
        self.poses.remove(&key).map(|kept| kept.place)
    }
}

/// Whitened derivatives with respect to the poses (three columns each) and to the landmark, and the whitened
/// innovations.
pub(super) fn linearised(
    poses: &[Vector3<f64>],
    list: &[(Place, Measurement)],
    at: Vec2,
) -> Option<(DMatrix<f64>, DMatrix<f64>, DVector<f64>)> {
    let m = list.len();
    let (mut a, mut b, mut r) = (DMatrix::zeros(m, 3 * m), DMatrix::zeros(m, 2), DVector::zeros(m));
    for (k, (pose, (_, z))) in poses.iter().zip(list).enumerate() {
        let (by_pose, by_landmark) = jacobians(z.kind(), pose, &at.push(0.0))?;
        let weight = 1.0 / z.covariance()[(0, 0)].sqrt();
        (0..3).for_each(|c| a[(k, 3 * k + c)] = weight * by_pose[(0, c)]);
        (0..2).for_each(|c| b[(k, c)] = weight * by_landmark[(0, c)]);
        r[k] = weight * z.innovation(pose, &at.push(0.0)).x;
    }
    Some((a, b, r))
}

/// The positions that fit the measurements, the best one first.
pub(super) fn sought(poses: &[Vector3<f64>], list: &[(Place, Measurement)]) -> Vec<Vec2> {
    let (Some(pose), Some((_, last))) = (poses.last(), list.last()) else { return Vec::new() };
    let along = |angle: f64, depth: f64| {
        pose.xy() + Vec2::new((pose.z + angle).cos(), (pose.z + angle).sin()) * depth
    };
    let reach = poses.iter().map(|p| (p - pose).xy().norm()).fold(0.0, f64::max);
    let starts = (0..STARTS).map(|k| match last.kind() {
        Kind::Bearing => along(last.value().x, reach * 0.2 * 1.3_f64.powi(k as i32)),
        _ => along(k as f64 / STARTS as f64 * TAU, last.value().x),
    });
    let mut all: Vec<(Vec2, f64)> = starts.filter_map(|start| descend(poses, list, start)).collect();
    all.sort_by(|a, b| a.1.total_cmp(&b.1));
    let mut found: Vec<Vec2> = Vec::new();
    for (at, _) in all {
        let same = 0.1 * (at - pose.xy()).norm();
        if found.iter().all(|f| (f - at).norm() > same) {
            found.push(at);
        }
    }
    found
}

/// Levenberg-Marquardt over the landmark alone: its position, and the cost there.
fn descend(poses: &[Vector3<f64>], list: &[(Place, Measurement)], start: Vec2) -> Option<(Vec2, f64)> {
    let solver = LevenbergMarquardt {
        iterations: 30,
        damping: Damping::Factors {
            first: 1e-3,
            least: 1e-12,
            most: 1e8,
            shrink: 0.2,
            grow: 8.0,
            restart: 1e-12,
        },
        convergence: Convergence::Actual { relative: 1e-9 },
    };
    let normal = |at: &Vec2| match linearised(poses, list, *at) {
        Some((_, b, r)) => {
            let (hessian, gradient) = (b.tr_mul(&b), -b.tr_mul(&r));
            DenseNormal {
                hessian: hessian.fixed_view::<2, 2>(0, 0).into(),
                gradient: gradient.fixed_rows::<2>(0).into(),
                cost: 0.5 * r.norm_squared(),
            }
        }
        None => DenseNormal { hessian: Matrix2::zeros(), gradient: Vec2::zeros(), cost: f64::INFINITY },
    };
    let (at, normal, _) = minimise_dense(&solver, &start, 0.0, normal, |at, step| at + step);
    let cost = 2.0 * normal.cost;
    (cost.is_finite() && at.iter().all(|v| v.is_finite())).then_some((at, cost))
}
