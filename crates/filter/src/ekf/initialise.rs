//! Initialises the landmarks that one measurement does not determine, once several do; the search is in `delayed.rs`.

use super::active::Place;
use super::delayed::{Kept, MOST, linearised, sought};
use super::landmark::Verdict;
use super::state::{EkfSlam, Robot};
use crate::chi2;
use crate::covariance::Rows;
use crate::measure::Measurement;
use nalgebra::{DMatrix, Matrix2, Matrix3, Vector3};

/// The standard deviation of the landmark must be below this fraction of its distance, so that its linearisation is
/// valid: with 0.2, bearings alone gave landmarks with errors of eleven standard deviations.
const SHARPNESS: f64 = 0.05;

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
