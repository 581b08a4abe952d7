//! EKF-SLAM in the plane: poses of robots and landmarks in one Gaussian.
//!
//! Source: Smith, Self, Cheeseman, "Estimating uncertain spatial relationships in robotics" (1990); Dissanayake et al.
//! (2001). Modules: `state` is what all work on; `active` predicts and updates, `associate` does the data association,
//! `hypotheses` defers it (`views` weighs its sightings), `initialise` adds landmarks that one measurement does not determine (`delayed` searches their positions), `upkeep`
//! confirms and removes landmarks (`reach` is what the sensor sees), `recover` widens the pose when many sightings are
//! rejected (`recent`), `scatter` learns how large innovations are, `exchange` keeps the far part of the map passive (`region`, `passive`, `deferred`, `tiles`).

mod active;
mod associate;
mod config;
mod deferred;
mod delayed;
mod exchange;
mod hypotheses;
mod initialise;
mod landmark;
mod passive;
mod reach;
mod recent;
mod recover;
mod region;
mod scatter;
mod state;
mod tiles;
mod upkeep;
mod views;

pub use config::{Association, EkfConfig, Linearisation};
pub use hypotheses::Hypotheses;
pub use landmark::{FilterError, Landmark, LandmarkId, Verdict};

use crate::chi2;
use crate::log::{Sighting, Target};
use crate::measure::Measurement;
use crate::motion::Motion;
use active::{Active, Linear};
use cairn_geometry::{Se2, Vec2};
use config::FAR;
use delayed::Delayed;
use landmark::Record;
use nalgebra::{Matrix3, Vector3};
use reach::Reach;
use recent::Recent;
use region::Region;
use scatter::Scatter;
use state::Robot;
use std::collections::BTreeMap;

pub use state::EkfSlam;

impl EkfSlam {
    /// A filter with an empty state.
    pub fn new(config: EkfConfig) -> Self {
        Self {
            active: Active::new(config.linearisation),
            robots: Vec::new(),
            landmarks: Vec::new(),
            by_label: BTreeMap::new(),
            next_id: 0,
            gates: [0, 1, 2, 3].map(|dof| config.gate(dof)),
            far: [0, 1, 2, 3].map(|dof| chi2::quantile(FAR, dof)),
            delayed: Delayed::default(),
            region: config.local_radius_m.map(Region::new),
            reach: Reach::default(),
            joined: BTreeMap::new(),
            recoveries: 0,
            config,
        }
    }

    /// Adds a robot at this pose, with the covariance of (x, y, angle) in the world, independent of the present state.
    /// Returns its number.
    ///
    /// # Errors
    /// When pose or covariance are not finite, or the covariance is not symmetric and positive semi-definite.
    pub fn add_robot(
        &mut self,
        world_from_body: &Se2,
        covariance: &Matrix3<f64>,
    ) -> Result<usize, FilterError> {
        let t = world_from_body;
        let pose = Vector3::new(t.translation.x, t.translation.y, t.rotation.log());
        let symmetric = (covariance - covariance.transpose()).amax() <= 1e-9 * covariance.amax();
        let valid = pose.iter().chain(covariance.iter()).all(|v| v.is_finite())
            && symmetric
            && covariance.symmetric_eigenvalues().min() >= -1e-12 * covariance.amax();
        if !valid {
            return Err(FilterError::NotFinite);
        }
        let place = self.active.add_pose(&pose, covariance);
        let recent = Recent::new(self.config.recovery_window);
        self.robots.push(Robot {
            place,
            store: None,
            recent,
            scatter: Scatter::default(),
            travelled_m: 0.0,
            moves: 0,
        });
        Ok(self.robots.len() - 1)
    }

    /// Propagates a robot by a motion.
    ///
    /// # Errors
    /// When there is no such robot, or the motion is not finite; nothing is changed then.
    pub fn predict(&mut self, robot: usize, motion: &Motion) -> Result<(), FilterError> {
        let known = self.robots.get_mut(robot).ok_or(FilterError::NoRobot(robot))?;
        if !motion.is_valid() {
            return Err(FilterError::NotFinite);
        }
        known.travelled_m += motion.before_from_after.translation.norm();
        known.moves += 1;
        known.recent.moved(&motion.covariance);
        self.active.predict(known.place, motion);
        Ok(())
    }

    /// Processes what a robot sees at one instant; returns a verdict on each sighting, in the same order.
    ///
    /// # Errors
    /// When there is no such robot.
    pub fn observe(&mut self, robot: usize, sightings: &[Sighting]) -> Result<Vec<Verdict>, FilterError> {
        if robot >= self.robots.len() {
            return Err(FilterError::NoRobot(robot));
        }
        self.keep_near_active(sightings);
        let labelled = self.config.association == Association::Known;
        let verdicts = if labelled {
            sightings.iter().map(|s| self.observe_labelled(robot, s)).collect()
        } else {
            self.observe_unlabelled(robot, sightings)
        };
        if let Some(region) = &mut self.region {
            region.settle();
        }
        Ok(verdicts)
    }

    fn observe_labelled(&mut self, robot: usize, sighting: &Sighting) -> Verdict {
        let m = &sighting.measurement;
        let label = match sighting.target {
            Target::Landmark(label) => label,
            Target::Robot(other) => return self.observe_robot(robot, other, sighting),
            Target::Unlabelled => return Verdict::Unusable,
        };
        let Some(&id) = self.by_label.get(&label) else {
            return match m.kind().determines() {
                true => self.found(robot, sighting, Some(label)),
                false => self.observe_delayed(robot, label, m),
            };
        };
        let place = self.record(id).and_then(|r| r.place);
        let Some(linear) = place.and_then(|to| self.active.linear(self.robots[robot].place, to, m)) else {
            return Verdict::Unusable;
        };
        let verdict = self.gated(robot, &linear, Some(id));
        match verdict {
            Verdict::Taken { .. } => self.was_seen(robot, id),
            _ => self.was_rejected(id),
        }
        verdict
    }

    fn observe_robot(&mut self, robot: usize, other: usize, sighting: &Sighting) -> Verdict {
        let places = (self.robots[robot].place, self.robots.get(other).map(|r| r.place));
        let (from, Some(to)) = places else { return Verdict::Unusable };
        if robot == other {
            return Verdict::Unusable;
        }
        match self.active.linear(from, to, &sighting.measurement) {
            Some(linear) => self.gated(robot, &linear, None),
            None => Verdict::Unusable,
        }
    }

    /// Updates by a measurement that is within its gate, or that recovery accepts. An outlier corrects as much as a sighting at
    /// the gate would (Huber's weight): what is rejected altogether would let a pose that is wrong stay wrong.
    fn gated(&mut self, robot: usize, linear: &Linear, landmark: Option<LandmarkId>) -> Verdict {
        let Some(plain) = linear.nis() else { return Verdict::Unusable };
        let (dof, gate, far) = (linear.h.rows, self.gates[linear.h.rows], self.far[linear.h.rows]);
        let known = &mut self.robots[robot];
        let factor = known.scatter.factor();
        known.scatter.learn(plain, gate.max(far), dof);
        let taken = Verdict::Taken { landmark, nis: plain / factor, dof };
        // As in `doubt`, a scatter that is smaller than believed makes nothing stricter.
        let (widened, nis) = (factor.max(1.0), plain / factor.max(1.0));
        let rejected = nis > gate;
        // Whether the pose is wrong does not hang on the gate: a narrow one rejects much that is right.
        known.recent.judged(nis > far);
        if !rejected {
            return if self.active.update(linear) { taken } else { Verdict::Unusable };
        }
        match self.recover(robot, linear, gate) {
            true => taken,
            false => {
                self.active.update(&linear.within(gate * widened));
                Verdict::Rejected { nis, gate }
            }
        }
    }

    /// Of a sighting of a landmark that is active: the normalised innovation squared, and the logarithm of the determinant of the innovation
    /// covariance. Their sum is minus twice the log likelihood of the sighting, up to a constant.
    pub fn innovation(&self, robot: usize, label: u32, m: &Measurement) -> Option<[f64; 2]> {
        let place = self.record(*self.by_label.get(&label)?)?.place?;
        let linear = self.active.linear(self.robots.get(robot)?.place, place, m)?;
        let rows = linear.h.rows;
        let s =
            Matrix3::from_fn(|i, j| if i < rows && j < rows { linear.s[(i, j)] } else { f64::from(i == j) });
        Some([linear.nis()?, s.determinant().ln()])
    }

    /// The pose of a robot as (x m, y m, angle rad), and its covariance.
    pub fn pose(&self, robot: usize) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let place = self.robots.get(robot)?.place;
        Some((self.active.value(place), self.active.block(place, place) * self.doubt()))
    }

    /// By how much covariances are larger than the noise alone says: the scatter of the innovations, where that is larger than
    /// believed. Where it is smaller, the errors of successive sightings may still be alike, so nothing becomes more certain.
    fn doubt(&self) -> f64 {
        self.robots.iter().map(|r| r.scatter.factor()).fold(1.0, f64::max)
    }

    /// All landmarks in order of rising numbers, tentative ones too.
    pub fn landmarks(&self) -> Vec<Landmark> {
        self.landmarks.iter().filter_map(|r| self.estimate(r)).collect()
    }

    /// Positions of the active landmarks, and how often each was seen.
    pub fn positions(&self) -> impl Iterator<Item = (LandmarkId, Vec2, usize)> {
        let of = |r: &Record| Some((r.id, self.active.value(r.place?).xy(), r.seen));
        self.landmarks.iter().filter_map(of)
    }

    /// The landmark with this label.
    pub fn labelled(&self, label: u32) -> Option<Landmark> {
        self.estimate(self.record(*self.by_label.get(&label)?)?)
    }

    fn estimate(&self, record: &Record) -> Option<Landmark> {
        let (position, covariance) = match (record.place, record.store, &self.region) {
            (Some(place), ..) => {
                let covariance = self.active.block(place, place).fixed_view::<2, 2>(0, 0).into_owned();
                (self.active.value(place).xy(), covariance)
            }
            (None, Some(store), Some(region)) => region.landmark(&self.active, store),
            _ => return None,
        };
        let Record { id, label, seen, confirmed, .. } = *record;
        let covariance = covariance * self.doubt();
        Some(Landmark { id, label, position, covariance, seen, confirmed })
    }

    fn record(&self, id: LandmarkId) -> Option<&Record> {
        self.landmarks.binary_search_by_key(&id, |r| r.id).ok().map(|k| &self.landmarks[k])
    }

    /// Whether there is a landmark with this number.
    pub(super) fn has(&self, id: LandmarkId) -> bool {
        self.record(id).is_some()
    }

    /// Landmarks that turned out to be the same as another, and that other one.
    pub fn joined(&self) -> &BTreeMap<LandmarkId, LandmarkId> {
        &self.joined
    }

    /// How often the filter had to widen a pose because many sightings were rejected.
    pub fn recoveries(&self) -> usize {
        self.recoveries
    }

    /// Dimension of the active part of the state.
    pub fn active_size(&self) -> usize {
        self.active.size()
    }
}
