//! Initialises the landmarks that one measurement does not determine, once several do; the search is in `delayed.rs`.

use super::active::Place;
use super::delayed::{Kept, MARGIN, MOST, linearised, sought};
use super::landmark::Verdict;
use super::state::{EkfSlam, Robot};
use crate::chi2;
use crate::covariance::Rows;
use crate::measure::Measurement;
use cairn_geometry::Vec2;
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
        let mut fits: Vec<Fit> =
            sought(&poses, list).into_iter().filter_map(|at| self.fit(&poses, list, at)).collect();
        fits.sort_by(|a, b| a.nis.total_cmp(&b.nis));
        if fits.get(1).is_some_and(|second| second.nis <= fits[0].nis + MARGIN) {
            return None;
        }
        let best = fits.into_iter().next()?;
        let distance = (best.at - poses[list.len() - 1].xy()).norm();
        let too_wide = best.spread.trace().sqrt() > SHARPNESS * distance;
        if too_wide || best.nis > chi2::quantile(0.999, list.len() - 2) {
            return None;
        }
        let noise = best.spread.fixed_resize::<3, 3>(0.0);
        let place = self.active.add_landmark(best.at.into(), &best.by_poses, &noise);
        self.active.update_together(best.rest);
        Some(place)
    }

    /// The landmark at a position that is a minimum of the measurements' errors for these poses.
    fn fit(&self, poses: &[Vector3<f64>], list: &[(Place, Measurement)], at: Vec2) -> Option<Fit> {
        let (a, b, r) = linearised(poses, list, at)?;
        // `Q^T [H_L | H_c | r]`: two rows determine the landmark, the others do not depend on it.
        let m = list.len();
        let mut q_t = DMatrix::identity(m, m);
        b.clone().qr().q_tr_mul(&mut q_t);
        let (by_landmark, by_poses, residual) = (&q_t * b, &q_t * a, &q_t * r);
        let root = by_landmark.fixed_view::<2, 2>(0, 0).into_owned();
        let inverse: Matrix2<f64> = root.try_inverse()?;
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
        Some(Fit {
            at: at + inverse * residual.fixed_rows::<2>(0),
            nis: self.active.nis_together(&rest)?,
            by_poses: rows(0, 2, &|i, l| -inverse[(i, l)]),
            spread: inverse * inverse.transpose(),
            rest,
        })
    }
}

/// A position that fits the measurements.
struct Fit {
    at: Vec2,
    /// Normalised innovation squared of all measurements, with the uncertainty of the poses.
    nis: f64,
    /// Derivative of the position by the poses.
    by_poses: Rows,
    /// Covariance of the position for given poses.
    spread: Matrix2<f64>,
    /// The rows that do not depend on the landmark, with their residuals.
    rest: Vec<(Rows, f64)>,
}
