//! Multiple hypothesis tracking: where it is not certain which landmarks were seen, a filter for each likely answer, until later
//! sightings decide.
//!
//! Sources: Reid, "An algorithm for tracking multiple targets", IEEE TAC 24(6), 1979; Cox and Leonard, "Modeling a dynamic environment
//! using a Bayesian multiple hypothesis approach", Artificial Intelligence 66(2), 1994. The answers of an instant are its jointly
//! compatible pairings; each costs minus twice the logarithm of its likelihood.
//!
//! Errors of successive sightings of one landmark are correlated, which no white noise describes. Associations need what a single sighting
//! scatters by; a map needs a noise that does not count a hundred sightings from one place as a hundred. So without labels there are two
//! filters for each answer: one that associates, and one that maps with the landmarks that the first one chose as labels. For the same
//! reason what an answer expected of a sighting counts in full only once from nearly the same position (`views`): a small error of a right
//! answer, seen four times a second, would else outweigh that a wrong one took something known for something new.

use super::associate::{Pairing, Unlabelled};
use super::config::{Association, EkfConfig, FAR, Linearisation};
use super::landmark::{FilterError, Landmark, LandmarkId, Verdict};
use super::state::EkfSlam;
use super::views::Views;
use crate::log::{Sighting, Target};
use crate::measure::Measurement;
use crate::motion::Motion;
use cairn_geometry::{Se2, Vec2};
use nalgebra::{Matrix3, Vector3};

/// Greatest number of answers that are followed.
const MOST: usize = 16;
/// An answer is dropped when it is this many times less likely than the best one: twice the logarithm.
const MARGIN: f64 = 2.0 * 9.2;
/// After so many instants with sightings the best answer is taken. Most of them see what was seen before from nearly the same position and
/// decide little.
const INSTANTS: usize = 400;

/// One answer.
#[derive(Clone, Debug)]
struct Branch {
    filter: EkfSlam,
    /// The filter that maps; `None` with labels, where one does both.
    map: Option<EkfSlam>,
    /// Minus twice the logarithm of its likelihood, less that of the best one.
    cost: f64,
    /// The results of the sightings since all branches were one.
    verdicts: Vec<Vec<Verdict>>,
}

impl Branch {
    /// Hands the sightings of an instant to the map, with the landmarks that they were found to be of.
    fn observe_map(
        &mut self,
        robot: usize,
        (sightings, mapping): (&[Sighting], Option<&[Measurement]>),
        verdicts: &[Verdict],
    ) -> Result<(), FilterError> {
        let Some(map) = &mut self.map else { return Ok(()) };
        let labelled = |(k, (s, verdict)): (usize, (&Sighting, &Verdict))| {
            let target = match (s.target, verdict) {
                (Target::Robot(other), _) => Target::Robot(other),
                (_, Verdict::Taken { landmark: Some(id), .. } | Verdict::New { landmark: id }) => {
                    Target::Landmark(id.0)
                }
                _ => return None,
            };
            let measurement = mapping.and_then(|m| m.get(k)).copied().unwrap_or(s.measurement);
            Some(Sighting { target, measurement })
        };
        let seen: Vec<Sighting> = sightings.iter().zip(verdicts).enumerate().filter_map(labelled).collect();
        map.observe(robot, &seen)?;
        self.filter.joined().iter().for_each(|(gone, kept)| map.join_labelled(gone.0, kept.0));
        map.keep_labels(|label| self.filter.has(LandmarkId(label)));
        Ok(())
    }
}

/// One filter, or several where it is not certain which landmarks were seen ([`Association::Deferred`]).
#[derive(Clone, Debug)]
pub struct Hypotheses {
    /// The likeliest first.
    branches: Vec<Branch>,
    decided: Vec<Vec<Verdict>>,
    views: Views,
}

impl Hypotheses {
    /// With one empty answer.
    pub fn new(config: EkfConfig) -> Self {
        let labelled = config.association == Association::Known;
        // Where later sightings decide, their likelihood against that of something new does so, and a gate only saves work.
        let gate_probability =
            if config.association == Association::Deferred { FAR } else { config.gate_probability };
        let config = EkfConfig { gate_probability, ..config };
        let map = (!labelled).then(|| EkfSlam::new(EkfConfig { association: Association::Known, ..config }));
        let linearisation = if labelled { config.linearisation } else { Linearisation::First };
        let filter = EkfSlam::new(EkfConfig { linearisation, ..config });
        let branches = vec![Branch { filter, map, cost: 0.0, verdicts: Vec::new() }];
        Self { branches, decided: Vec::new(), views: Views::default() }
    }

    /// Adds a robot, as [`EkfSlam::add_robot`].
    ///
    /// # Errors
    /// As there.
    pub fn add_robot(
        &mut self,
        world_from_body: &Se2,
        covariance: &Matrix3<f64>,
    ) -> Result<usize, FilterError> {
        let mut number = 0;
        for branch in &mut self.branches {
            number = branch.filter.add_robot(world_from_body, covariance)?;
            if let Some(map) = &mut branch.map {
                map.add_robot(world_from_body, covariance)?;
            }
        }
        self.views.add_robot();
        Ok(number)
    }

    /// Propagates a robot by a motion; `mapping` is the same with the noise for the map, where that is another one. Only without
    /// labels there is a map of its own.
    ///
    /// # Errors
    /// As [`EkfSlam::predict`]; nothing is changed then.
    pub fn predict(
        &mut self,
        robot: usize,
        motion: &Motion,
        mapping: Option<&Motion>,
    ) -> Result<(), FilterError> {
        let mapping = mapping.unwrap_or(motion);
        if !mapping.is_valid() {
            return Err(FilterError::NotFinite);
        }
        self.branches.iter_mut().try_for_each(|b| {
            b.filter.predict(robot, motion)?;
            b.map.as_mut().map_or(Ok(()), |map| map.predict(robot, mapping))
        })?;
        self.views.predict(robot, motion)
    }

    /// Processes what a robot sees at one instant; `mapping` are the measurements of the sightings with the noise for the map, where
    /// that is another one. Only without labels there is a map of its own.
    ///
    /// # Errors
    /// As [`EkfSlam::observe`], and when there are measurements for the map, but not one for each sighting.
    pub fn observe(
        &mut self,
        robot: usize,
        sightings: &[Sighting],
        mapping: Option<&[Measurement]>,
    ) -> Result<(), FilterError> {
        if let Some(mapping) = mapping.filter(|m| m.len() != sightings.len()) {
            return Err(FilterError::Measurements(sightings.len(), mapping.len()));
        }
        let deferred = self.best().config.association == Association::Deferred;
        if !deferred || robot >= self.best().robots.len() {
            for branch in &mut self.branches {
                let verdicts = branch.filter.observe(robot, sightings)?;
                branch.observe_map(robot, (sightings, mapping), &verdicts)?;
                branch.verdicts.push(verdicts);
            }
        } else {
            self.branches.iter_mut().for_each(|b| b.filter.keep_near_active(sightings));
            self.branch(robot, sightings, mapping)?;
            for region in self.branches.iter_mut().filter_map(|b| b.filter.region.as_mut()) {
                region.settle();
            }
        }
        self.decide();
        Ok(())
    }

    /// Follows each likely pairing of each branch.
    fn branch(
        &mut self,
        robot: usize,
        sightings: &[Sighting],
        mapping: Option<&[Measurement]>,
    ) -> Result<(), FilterError> {
        let seen: Vec<Unlabelled> =
            self.branches.iter().map(|b| b.filter.unlabelled(robot, sightings)).collect();
        let spacing_m = self.best().config.delayed_spacing_m;
        let weights = self.views.weights(robot, sightings, spacing_m);
        let mut next: Vec<(usize, Vec<Option<usize>>, f64)> = Vec::new();
        for (k, (branch, seen)) in self.branches.iter().zip(&seen).enumerate() {
            let pairings = branch.filter.pairings(seen, MOST, &weights);
            let Some((best, counted)) = pairings.first().map(|p| (p.cost, p.counted)) else { continue };
            // What one answer says of a sighting is compared in full, what different answers expected of it by what it says that the
            // sightings before it did not.
            let cost = |p: Pairing| (k, p.chosen, branch.cost + counted + p.cost - best);
            next.extend(pairings.into_iter().map(cost));
        }
        next.sort_by(|a, b| a.2.total_cmp(&b.2).then(a.0.cmp(&b.0)));
        let Some(least) = next.first().map(|n| n.2) else { return Ok(()) };
        next.retain(|(_, _, cost)| cost.total_cmp(&(least + MARGIN)).is_le());
        next.truncate(MOST);
        let mut left: Vec<usize> =
            (0..seen.len()).map(|k| next.iter().filter(|n| n.0 == k).count()).collect();
        let mut before: Vec<Option<Branch>> = self.branches.drain(..).map(Some).collect();
        for (k, chosen, cost) in next {
            left[k] -= 1;
            // The last one that follows from a branch needs no copy.
            let from = if left[k] == 0 { before[k].take() } else { before[k].clone() };
            let Some(mut branch) = from else { continue };
            let verdicts = branch.filter.pair(robot, sightings, &seen[k], &chosen);
            branch.observe_map(robot, (sightings, mapping), &verdicts)?;
            branch.verdicts.push(verdicts);
            branch.cost = cost - least;
            self.branches.push(branch);
        }
        Ok(())
    }

    /// Where one branch is left, its results are final.
    fn decide(&mut self) {
        if self.branches.first().is_some_and(|b| b.verdicts.len() > INSTANTS) {
            self.branches.truncate(1);
        }
        if let [only] = self.branches.as_mut_slice() {
            self.decided.append(&mut only.verdicts);
        }
    }

    /// The filter that associates, of the likeliest answer.
    pub fn best(&self) -> &EkfSlam {
        &self.branches[0].filter
    }

    /// The filter that maps.
    fn map(&self) -> &EkfSlam {
        self.branches[0].map.as_ref().unwrap_or(&self.branches[0].filter)
    }

    /// The pose of a robot by the likeliest answer, and its covariance.
    pub fn pose(&self, robot: usize) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        self.map().pose(robot)
    }

    /// All landmarks of the likeliest answer in order of rising numbers, tentative ones too.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let (known, map) = (self.best().landmarks(), self.branches[0].map.as_ref());
        let mapped = |l: Landmark| match map.and_then(|map| map.labelled(l.id.0)) {
            Some(Landmark { position, covariance, .. }) => Landmark { position, covariance, ..l },
            None => l,
        };
        known.into_iter().map(mapped).collect()
    }

    /// Positions of the active landmarks of the filter that maps, by its own numbers, and how often each was seen.
    pub fn positions(&self) -> impl Iterator<Item = (LandmarkId, Vec2, usize)> {
        self.map().positions()
    }

    /// How often the pose was widened because many sightings were rejected.
    pub fn recoveries(&self) -> usize {
        self.map().recoveries()
    }

    /// How many answers are followed.
    pub fn count(&self) -> usize {
        self.branches.len()
    }

    /// The results of the sightings, instant by instant, by the likeliest answer; those of an instant that is not decided may change.
    pub fn verdicts(&self) -> impl Iterator<Item = &[Verdict]> {
        self.decided.iter().chain(&self.branches[0].verdicts).map(Vec::as_slice)
    }
}
