//! Delayed initialisation of landmarks that one measurement does not determine: ranges or bearings are stored, each
//! with the pose it was taken from, until together they determine the position of the landmark.
//!
//! The poses are kept in the state (stochastic cloning, Roumeliotis and Burdick 2002), so that the landmark gets its
//! true correlations: the measurements are rotated so that two rows determine the landmark and initialise it, and the
//! other rows correct the state (the nullspace projection of Mourikis and Roumeliotis 2007, equations 23-24). The two
//! mirrored solutions of ranges along a line are distinguished by their likelihoods; until that is possible, the
//! landmark waits.

use super::active::Place;
use super::landmark::Verdict;
use super::{EkfSlam, Robot};
use crate::chi2;
use crate::covariance::Rows;
use crate::measure::{Kind, Measurement, jacobians};
use cairn_geometry::Vec2;
use nalgebra::{DMatrix, DVector, Matrix2, Matrix3, Vector3};
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Greatest number of measurements stored per landmark; beyond it, the one nearest to its neighbour is dropped, so that
/// the baseline grows.
const MOST: usize = 12;
/// The second best position must be less likely by this much (twice the log likelihood ratio: about 1 in 400).
const MARGIN: f64 = 12.0;
/// The standard deviation of the landmark must be below this fraction of its distance, so that its linearisation is
/// valid: with 0.2, bearings alone gave landmarks with errors of eleven standard deviations.
const SHARPNESS: f64 = 0.05;
/// Number of directions, and of depths, from which the search for a position starts.
const STARTS: usize = 24;

/// A pose kept in the state for the measurements taken from it.
#[derive(Clone, Debug)]
struct Kept {
    place: Place,
    robot: usize,
    travelled_m: f64,
    moves: usize,
}

/// Landmarks that are not initialised yet.
#[derive(Clone, Debug, Default)]
pub(crate) struct Delayed {
    poses: BTreeMap<u32, Kept>,
    next: u32,
    waiting: BTreeMap<u32, Vec<(u32, Measurement)>>,
}

/// Position of a landmark according to the measurements, and their cost there.
struct Found {
    at: Vec2,
    cost: f64,
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
    fn unused(&mut self) -> Option<Place> {
        let used = |key: &u32| self.waiting.values().flatten().any(|(k, _)| k == key);
        let key = *self.poses.keys().find(|key| !used(key))?;
        self.poses.remove(&key).map(|kept| kept.place)
    }
}

impl EkfSlam {
    /// Stores the measurement, and initialises the landmark when that is possible.
    pub(super) fn observe_delayed(&mut self, robot: usize, label: u32, m: &Measurement) -> Verdict {
        let Robot { travelled_m, moves, .. } = self.robots[robot];
        let kept = self.delayed.waiting.get(&label).map_or(&[][..], |w| w);
        let last = kept.last().and_then(|(key, _)| self.delayed.poses.get(key));
        let soon = |k: &Kept| k.robot == robot && travelled_m - k.travelled_m < self.config.delayed_spacing_m;
        if last.is_some_and(soon) {
            return Verdict::Waiting { kept: kept.len() };
        }
        let same = |k: &&Kept| k.robot == robot && k.moves == moves;
        let here = self.delayed.poses.iter().find(|(_, k)| same(k)).map(|(key, _)| *key);
        let key = here.unwrap_or_else(|| {
            let place = self.active.clone_pose(self.robots[robot].place);
            self.delayed.next += 1;
            self.delayed.poses.insert(self.delayed.next, Kept { place, robot, travelled_m, moves });
            self.delayed.next
        });
        let waiting = self.delayed.waiting.entry(label).or_default();
        waiting.push((key, *m));
        if waiting.len() > MOST {
            let at = |k: usize| self.delayed.poses.get(&waiting[k].0).map_or(0.0, |kept| kept.travelled_m);
            let gap = |k: &usize| (at(*k) - at(k - 1)).abs();
            let closest = (1..MOST).min_by(|a, b| gap(a).total_cmp(&gap(b)));
            waiting.remove(closest.unwrap_or(0));
        }
        let list: Vec<(Place, Measurement)> =
            waiting.iter().filter_map(|(key, m)| Some((self.delayed.poses.get(key)?.place, *m))).collect();
        let verdict = match self.place_landmark(&list) {
            Some(place) => {
                self.delayed.waiting.remove(&label);
                Verdict::New { landmark: self.enter(place, Some(label)) }
            }
            None => Verdict::Waiting { kept: list.len() },
        };
        while let Some(place) = self.delayed.unused() {
            self.remove_place(place);
        }
        verdict
    }

    fn place_landmark(&mut self, list: &[(Place, Measurement)]) -> Option<Place> {
        if list.len() < 4 {
            return None;
        }
        let poses: Vec<Vector3<f64>> = list.iter().map(|(p, _)| self.active.value(*p)).collect();
        let found = sought(&poses, list)?;
        let (a, b, r) = linearised(&poses, list, found.at)?;
        // `Q^T [H_L | H_c | r]`: two rows determine the landmark, the others do not depend on it.
        let m = list.len();
        let mut q_t = DMatrix::identity(m, m);
        b.clone().qr().q_tr_mul(&mut q_t);
        let (by_landmark, by_poses, residual) = (&q_t * b, &q_t * a, &q_t * r);
        let root = by_landmark.fixed_view::<2, 2>(0, 0).into_owned();
        let inverse: Matrix2<f64> = root.try_inverse()?;
        let spread = inverse * inverse.transpose();
        let distance = (found.at - poses[m - 1].xy()).norm();
        if spread.trace().sqrt() > SHARPNESS * distance {
            return None;
        }
        let rows = |first: usize, count: usize, scale: &dyn Fn(usize, usize) -> f64| Rows {
            rows: count,
            blocks: list
                .iter()
                .enumerate()
                .map(|(k, (place, _))| {
                    let of = |i: usize, j: usize| {
                        (0..count).map(|l| scale(i, l) * by_poses[(first + l, 3 * k + j)]).sum()
                    };
                    (place.at, 3, Matrix3::from_fn(|i, j| if i < count { of(i, j) } else { 0.0 }))
                })
                .collect(),
        };
        let rest: Vec<(Rows, f64)> = (2..m).map(|k| (rows(k, 1, &|_, _| 1.0), residual[k])).collect();
        let unit = Matrix3::identity();
        let nis = rest
            .iter()
            .filter_map(|(h, r)| self.active.linear_rows(h.clone(), Vector3::new(*r, 0.0, 0.0), unit).nis());
        if nis.sum::<f64>() > chi2::quantile(0.999, m - 2) {
            return None;
        }
        let g = rows(0, 2, &|i, l| -inverse[(i, l)]);
        let at = found.at + inverse * residual.fixed_rows::<2>(0);
        let place = self.active.add_landmark(at.into(), &g, &spread.fixed_resize::<3, 3>(0.0));
        // Each row moves the state, so the expected values of the other rows change too.
        let before: Vec<Vector3<f64>> = list.iter().map(|(p, _)| self.active.value(*p)).collect();
        for (h, r) in rest {
            let moved: f64 = h
                .blocks
                .iter()
                .zip(list.iter().zip(&before))
                .map(|((_, _, by), ((p, _), was))| (by * (self.active.value(*p) - was))[0])
                .sum();
            let linear = self.active.linear_rows(h, Vector3::new(r - moved, 0.0, 0.0), unit);
            self.active.update(&linear);
        }
        Some(place)
    }
}

/// Whitened derivatives with respect to the poses (three columns each) and to the landmark, and the whitened
/// innovations.
fn linearised(
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

/// The one position that fits the measurements; `None` while there are two.
fn sought(poses: &[Vector3<f64>], list: &[(Place, Measurement)]) -> Option<Found> {
    let (pose, (_, last)) = (poses.last()?, list.last()?);
    let along = |angle: f64, depth: f64| {
        pose.xy() + Vec2::new((pose.z + angle).cos(), (pose.z + angle).sin()) * depth
    };
    let reach = poses.iter().map(|p| (p - pose).xy().norm()).fold(0.0, f64::max);
    let starts = (0..STARTS).map(|k| match last.kind() {
        Kind::Bearing => along(last.value().x, reach * 0.2 * 1.3_f64.powi(k as i32)),
        _ => along(k as f64 / STARTS as f64 * TAU, last.value().x),
    });
    let mut found: Vec<Found> = starts.filter_map(|start| descend(poses, list, start)).collect();
    found.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = found.first()?;
    let distance = (best.at - pose.xy()).norm();
    let second = found.iter().find(|f| (f.at - best.at).norm() > 0.1 * distance);
    let clear = second.is_none_or(|s| s.cost > best.cost + MARGIN);
    clear.then(|| found.swap_remove(0))
}

/// Gauss-Newton over the landmark alone.
fn descend(poses: &[Vector3<f64>], list: &[(Place, Measurement)], start: Vec2) -> Option<Found> {
    let (mut at, mut lambda) = (start, 1e-3);
    let (_, mut b, mut r) = linearised(poses, list, at)?;
    for _ in 0..30 {
        let (h, g) = (b.tr_mul(&b), b.tr_mul(&r));
        let damped =
            Matrix2::new(h[(0, 0)] * (1.0 + lambda), h[(0, 1)], h[(1, 0)], h[(1, 1)] * (1.0 + lambda));
        let step = damped.try_inverse()? * Vec2::new(g[0], g[1]);
        let Some((_, next_b, next_r)) = linearised(poses, list, at + step) else { break };
        if next_r.norm_squared() < r.norm_squared() {
            at += step;
            (b, r, lambda) = (next_b, next_r, lambda * 0.2);
        } else {
            lambda *= 8.0;
        }
        if step.norm() < 1e-6 * (1.0 + (at - start).norm()) || lambda > 1e8 {
            break;
        }
    }
    at.iter().all(|v| v.is_finite()).then(|| Found { at, cost: r.norm_squared() })
}
