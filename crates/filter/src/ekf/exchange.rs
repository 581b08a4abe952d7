//! Which landmarks are active: those near the robots. The others are in the passive store.

use super::config::Association;
use super::passive::Member;
use super::region::Region;
use super::state::{EkfSlam, Robot};
use crate::log::{Sighting, Target};
use crate::measure::Kind;

impl EkfSlam {
    /// Chooses the region again when a robot has left its inner half, or when a passive landmark is seen.
    pub(super) fn keep_near_active(&mut self, sightings: &[Sighting]) {
        let Some(region) = &self.region else { return };
        let far = |(k, r): (usize, &Robot)| {
            let here = self.active.value(r.place).xy();
            region.centres.get(k).is_none_or(|c| (here - c).norm() > 0.5 * region.radius_m)
        };
        let seen: Vec<usize> = sightings.iter().filter_map(|s| self.passive_target(s)).collect();
        if seen.is_empty() && !self.robots.iter().enumerate().any(far) {
            return;
        }
        self.lay_region(&seen);
    }

    /// List index of a labelled landmark that is passive.
    fn passive_target(&self, sighting: &Sighting) -> Option<usize> {
        let Target::Landmark(label) = sighting.target else { return None };
        let id = self.by_label.get(&label)?;
        let k = self.landmarks.binary_search_by_key(id, |r| r.id).ok()?;
        (self.config.association == Association::Known && self.landmarks[k].place.is_none()).then_some(k)
    }

    fn lay_region(&mut self, seen: &[usize]) {
        let Some(mut region) = self.region.take() else { return };
        region.centres = self.robots.iter().map(|r| self.active.value(r.place).xy()).collect();
        let near: Vec<bool> = self
            .landmarks
            .iter()
            .enumerate()
            .map(|(k, record)| {
                let at = match (record.place, record.store) {
                    (Some(place), _) => self.active.value(place).xy(),
                    (None, Some(store)) => region.landmark(&self.active, store).0,
                    (None, None) => return true,
                };
                seen.contains(&k) || region.centres.iter().any(|c| (at - c).norm() <= region.radius_m)
            })
            .collect();
        if self.landmarks.iter().zip(&near).any(|(record, near)| record.place.is_some() != *near) {
            self.exchange(&mut region, &near);
        }
        self.region = Some(region);
    }

    /// Moves everything active into the store, and everything near out of it.
    fn exchange(&mut self, region: &mut Region, near: &[bool]) {
        // Poses kept for delayed initialisation are dropped when the region changes.
        while let Some(place) = self.delayed.give_up() {
            self.remove_place(place);
        }
        let passive = &mut region.passive;
        let mut members = Vec::new();
        for robot in &mut self.robots {
            let store = *robot.store.get_or_insert_with(|| passive.allot(3));
            members.push(Member { place: robot.place, store });
        }
        for record in &mut self.landmarks {
            if let Some(place) = record.place {
                let store = *record.store.get_or_insert_with(|| passive.allot(2));
                members.push(Member { place, store });
            }
        }
        passive.close(&mut self.active, &members);
        let robots = self.robots.iter().filter_map(|r| Some((r.store?, 3)));
        let landmarks = self.landmarks.iter().zip(near).filter(|(_, near)| **near);
        let wanted: Vec<(usize, usize)> =
            robots.chain(landmarks.filter_map(|(r, _)| Some((r.store?, 2)))).collect();
        let mut places = passive.open(&mut self.active, &wanted).into_iter();
        for (robot, place) in self.robots.iter_mut().zip(&mut places) {
            robot.place = place;
        }
        for (record, near) in self.landmarks.iter_mut().zip(near) {
            record.place = if *near { places.next() } else { None };
        }
    }

    /// Whether all landmarks that this sighting might belong to are active.
    pub(super) fn within_reach(&self, sighting: &Sighting) -> bool {
        let m = &sighting.measurement;
        let range_m = match m.kind() {
            Kind::RangeBearing | Kind::Range => m.value().x,
            Kind::Position | Kind::RelativePose => m.value().xy().norm(),
            Kind::Bearing => 0.0,
        };
        self.region.as_ref().is_none_or(|r| range_m <= 0.5 * r.radius_m)
    }
}
