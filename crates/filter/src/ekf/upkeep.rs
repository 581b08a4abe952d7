//! Initialises landmarks, confirms them, and removes those that should be seen but are not.

use super::active::{Linear, Place};
use super::landmark::{LandmarkId, Record, Verdict};
use super::state::EkfSlam;
use crate::covariance::Rows;
use crate::log::Sighting;
use crate::measure::{Kind, expected};
use nalgebra::{Matrix3, Vector3};

/// A landmark rejected this often in a row, while others are accepted, has moved; it is removed and initialised again.
const MOVED: usize = 15;
/// Log odds of absence at which a tentative landmark is removed (a chance of 1 in 20 that it still exists).
const PROVISIONAL: f64 = 3.0;
/// The same for a confirmed landmark: a person who stands in front of it for a while must not cause its removal.
const CONFIRMED: f64 = 20.0;

impl EkfSlam {
    /// Initialises a landmark from a sighting.
    pub(super) fn found(&mut self, robot: usize, sighting: &Sighting, label: Option<u32>) -> Verdict {
        match self.active.found(self.robots[robot].place, &sighting.measurement) {
            Some(place) => Verdict::New { landmark: self.enter(place, label) },
            None => Verdict::Unusable,
        }
    }

    /// Registers a new landmark at this place of the active state.
    pub(super) fn enter(&mut self, place: Place, label: Option<u32>) -> LandmarkId {
        let id = LandmarkId(self.next_id);
        self.next_id += 1;
        if let Some(label) = label {
            self.by_label.insert(label, id);
        }
        self.landmarks.push(Record {
            id,
            label,
            place: Some(place),
            store: None,
            seen: 1,
            rejected: 0,
            absence: 0.0,
            missed_at_m: 0.0,
            views: 1,
            viewed_at_m: self.robots.first().map_or(0.0, |r| r.travelled_m),
            confirmed: label.is_some() || self.config.confirm_sightings <= 1,
        });
        id
    }

    pub(super) fn was_seen(&mut self, robot: usize, id: LandmarkId) {
        let (confirm, travelled_m) = (self.config.confirm_sightings, self.robots[robot].travelled_m);
        if let Ok(k) = self.landmarks.binary_search_by_key(&id, |r| r.id) {
            let record = &mut self.landmarks[k];
            record.seen += 1;
            record.rejected = 0;
            record.absence = 0.0;
            // Sightings from nearly the same position have similar errors: they count as one view.
            if travelled_m - record.viewed_at_m >= self.config.delayed_spacing_m {
                (record.views, record.viewed_at_m) = (record.views + 1, travelled_m);
            }
            record.confirmed |= record.views >= confirm;
        }
    }

    /// A labelled landmark that is rejected again and again has moved, or was initialised wrongly: it is removed, and
    /// initialised again by its next sighting.
    pub(super) fn was_rejected(&mut self, id: LandmarkId) {
        if let Ok(k) = self.landmarks.binary_search_by_key(&id, |r| r.id) {
            self.landmarks[k].rejected += 1;
            if self.landmarks[k].rejected >= MOVED {
                self.drop_landmark(k);
            }
        }
    }

    /// Counts the landmarks within range that were missed, and removes those that must be gone.
    pub(super) fn count_missed(&mut self, robot: usize, sightings: &[Sighting], taken: &[LandmarkId]) {
        sightings.iter().for_each(|s| self.reach.learn(s));
        let pose = self.active.value(self.robots[robot].place);
        let (range_m, bearing_rad) = (0.5 * self.reach.range_m, 0.8 * self.reach.bearing_rad);
        let travelled_m = self.robots[robot].travelled_m;
        let mut gone = Vec::new();
        for (k, record) in self.landmarks.iter_mut().enumerate() {
            let Some(place) = record.place else { continue };
            if taken.contains(&record.id) {
                self.reach.seen += f64::from(u8::from(record.confirmed));
                continue;
            }
            let at = expected(Kind::RangeBearing, &pose, &self.active.value(place));
            // Misses from nearly the same position count as one: the same object may be in front of the landmark.
            let again = record.confirmed && travelled_m - record.missed_at_m < self.config.delayed_spacing_m;
            if at.x < range_m && at.y.abs() < bearing_rad && !again {
                record.missed_at_m = travelled_m;
                self.reach.missed += f64::from(u8::from(record.confirmed));
                record.absence += self.reach.miss();
                if record.absence > if record.confirmed { CONFIRMED } else { PROVISIONAL } {
                    gone.push(k);
                }
            }
        }
        gone.into_iter().rev().for_each(|k| self.drop_landmark(k));
    }

    /// Merges a landmark that was just seen with another at the same position: within its gate, with no third landmark
    /// in between, and never seen together with it.
    pub(super) fn join_twins(&mut self, taken: &[LandmarkId]) {
        for &id in taken {
            let Some(own) = self.record(id).filter(|r| r.confirmed).and_then(|r| Some((r.place?, r.seen)))
            else {
                continue;
            };
            let near: Vec<(usize, Linear)> = self
                .landmarks
                .iter()
                .enumerate()
                .filter(|(_, r)| r.id != id)
                .filter_map(|(k, r)| Some((k, self.apart(own.0, r.place?))))
                .filter(|(_, l)| l.nis().is_some_and(|nis| nis <= self.gates[2]))
                .collect();
            let [(other, linear)] = near.as_slice() else { continue };
            if taken.contains(&self.landmarks[*other].id) || !self.active.update(linear) {
                continue;
            }
            let (keep, lose) = (self.landmarks.binary_search_by_key(&id, |r| r.id), *other);
            let Ok(keep) = keep else { continue };
            let (keep, lose) = if self.landmarks[lose].seen > own.1 { (lose, keep) } else { (keep, lose) };
            self.landmarks[keep].seen += self.landmarks[lose].seen;
            let gone = self.landmarks[lose].id;
            self.joined.insert(gone, self.landmarks[keep].id);
            self.drop_landmark(lose);
        }
    }

    /// Two labels turned out to be of one landmark: the first one is gone, and both were in the same place.
    pub(super) fn join_labelled(&mut self, gone: u32, kept: u32) {
        let index = |label| {
            let id = self.by_label.get(&label)?;
            self.landmarks.binary_search_by_key(id, |r| r.id).ok()
        };
        let (Some(lose), Some(keep)) = (index(gone), index(kept)) else { return };
        if let (Some(a), Some(b)) = (self.landmarks[lose].place, self.landmarks[keep].place) {
            let linear = self.apart(a, b);
            self.active.update(&linear);
        }
        self.landmarks[keep].seen += self.landmarks[lose].seen;
        self.drop_landmark(lose);
    }

    /// Removes the landmarks of all other labels.
    pub(super) fn keep_labels(&mut self, keep: impl Fn(u32) -> bool) {
        for k in (0..self.landmarks.len()).rev() {
            if self.landmarks[k].label.is_some_and(|label| !keep(label)) {
                self.drop_landmark(k);
            }
        }
    }

    /// The measurement that two landmarks are the same: their difference is zero.
    fn apart(&self, a: Place, b: Place) -> Linear {
        let unit = |sign: f64| Matrix3::from_diagonal(&Vector3::new(sign, sign, 0.0));
        let h = Rows { rows: 2, blocks: vec![(a.at, 2, unit(1.0)), (b.at, 2, unit(-1.0))] };
        let difference = self.active.value(b) - self.active.value(a);
        self.active.linear_rows(h, difference, Matrix3::identity() * 1e-6)
    }

    fn drop_landmark(&mut self, k: usize) {
        let record = self.landmarks.remove(k);
        if let Some(label) = record.label {
            self.by_label.remove(&label);
        }
        if let (Some(store), Some(region)) = (record.store, &mut self.region) {
            region.release(store);
        }
        if let Some(place) = record.place {
            self.remove_place(place);
        }
    }

    /// Removes a variable from the active state; the variables after it move up.
    pub(super) fn remove_place(&mut self, gone: Place) {
        self.active.remove(gone);
        let places = self.robots.iter_mut().map(|r| &mut r.place);
        let places = places.chain(self.landmarks.iter_mut().filter_map(|r| r.place.as_mut()));
        for place in places.chain(self.delayed.places_mut()).filter(|p| p.at > gone.at) {
            place.at -= gone.size;
        }
    }
}
