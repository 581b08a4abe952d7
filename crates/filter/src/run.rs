//! Runs one robot's log through the filter: results of its sightings, consistency of its covariance, and comparison
//! with smoothing and with a survey.

use crate::batch::{BatchConfig, BatchReport, Smoothed, smooth};
use crate::calibrate::calibrated;
use crate::chi2;
use crate::ekf::{Association, EkfConfig, FilterError, Hypotheses, Landmark, LandmarkId, Verdict};
use crate::frame::Steady;
use crate::log::{Log, Noise, RobotLog, Sighting, Step, Target};
use crate::measure::{Measurement, MeasurementError};
use cairn_geometry::{Se2, Vec2, Vec3, umeyama};
use nalgebra::{Matrix2, Matrix3, Vector3};
use std::collections::BTreeMap;
use std::time::Instant;

/// Greatest number of snapshots kept for a replay.
const SNAPSHOTS: usize = 240;

/// Why a log cannot be run.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum RunError {
    /// There is no such robot in the log.
    #[error("the log has no robot {0}")]
    NoRobot(usize),
    /// A sighting with the log's noise is not a valid measurement.
    #[error("a sighting cannot be used: {0}")]
    Measurement(#[from] MeasurementError),
    /// The filter rejects a motion of the log.
    #[error("a motion cannot be used: {0}")]
    Filter(#[from] FilterError),
}

/// Results of the sightings.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    /// Sightings that corrected the state.
    pub taken: usize,
    /// Sightings that initialised a landmark.
    pub new: usize,
    /// Sightings outside the gate, or ambiguous.
    pub rejected: usize,
    /// Sightings stored for a landmark that is not initialised yet, or that could not be used.
    pub waiting: usize,
}

/// The state at an instant.
#[derive(Clone, Debug, PartialEq)]
pub struct Snapshot {
    /// Seconds from the start of the log.
    pub time_s: f64,
    /// Index of the step.
    pub step: usize,
    /// From the frame whose origin is the start to that of the run, as far as it was known then.
    pub map_from_start: Se2,
    /// Pose (x m, y m, angle rad).
    pub pose: Vector3<f64>,
    /// Its covariance, with respect to the start.
    pub covariance: Matrix3<f64>,
    /// Landmarks with their covariance.
    pub landmarks: Vec<Landmark>,
}

/// A finished run.
#[derive(Clone, Debug, PartialEq)]
pub struct Run {
    /// The robot's name.
    pub robot: String,
    /// When it began, in seconds from the start of the log: the pose there is the origin.
    pub began_s: f64,
    /// Times of the poses, in seconds from the start of the log.
    pub times_s: Vec<f64>,
    /// Filtered poses (x m, y m, angle rad) at the steps, as they were known then, in the frame of the map ([`Steady`]).
    pub poses: Vec<Vector3<f64>>,
    /// Landmarks at the end, in the frame of the map.
    pub landmarks: Vec<Landmark>,
    /// The most frequent label among the sightings of each landmark, for evaluation where labels are not used.
    pub names: BTreeMap<LandmarkId, u32>,
    /// The noise of odometry and sensor that it believed.
    pub noise: Noise,
    /// Results of the sightings.
    pub counts: Counts,
    /// Mean of the normalised innovation squared per degree of freedom: 1 when the noise model is right.
    pub nis_per_dof: f64,
    /// Fraction of the innovations, accepted or rejected, that are within their 95 % bound.
    pub nis_within_95: f64,
    /// Fraction of the associations with a landmark of another label; `None` where labels were used or absent.
    pub wrong_associations: Option<f64>,
    /// How often the covariance of the pose was widened by recovery.
    pub recoveries: usize,
    /// Time for preparing the steps and filtering, without reading and snapshots, in milliseconds.
    pub filter_ms: f64,
    /// Snapshots for a replay.
    pub snapshots: Vec<Snapshot>,
}

/// The noise for a robot of this log: where it is not known, and there are labels, the likeliest one ([`calibrated`]).
pub fn noise_of(log: &Log, recorded: &RobotLog, config: &EkfConfig) -> Noise {
    match config.association {
        Association::Known if !log.noise_known => calibrated(recorded, &log.noise, config),
        Association::Known => log.noise,
        _ => log.unlabelled_noise,
    }
}

/// Runs one robot of a log, from the origin.
///
/// # Errors
/// For a robot that the log does not have, and entries that no filter can use.
pub fn run(log: &Log, robot: usize, config: &EkfConfig) -> Result<Run, RunError> {
    let recorded = log.robots.get(robot).ok_or(RunError::NoRobot(robot))?;
    let began = Instant::now();
    let labelled = config.association == Association::Known;
    let noise = noise_of(log, recorded, config);
    let mut steps = recorded.steps(&noise, &[])?;
    // Without labels the map has a noise of its own; the same instants, so the same delay.
    let for_map = Noise { sighting_delay_s: log.unlabelled_noise.sighting_delay_s, ..log.noise };
    let mut mapping = if labelled { Vec::new() } else { recorded.steps(&for_map, &[])? };
    let mut filter = Hypotheses::new(*config);
    // The start defines the frame of the map, so it is known, except for a small variance against rounding.
    let id = filter.add_robot(&Se2::identity(), &(Matrix3::identity() * 1e-12))?;
    // The state contains only one robot.
    let of_landmark = |s: &Sighting| !matches!(s.target, Target::Robot(_));
    steps.iter_mut().chain(&mut mapping).for_each(|s| s.sightings.retain(of_landmark));
    let (mut frame, mut map_from_start) = (Steady::default(), Se2::identity());
    let (mut poses, mut snapshots) = (Vec::with_capacity(steps.len()), Vec::new());
    let every = steps.len().div_ceil(SNAPSHOTS).max(1);
    let mut snapshot_ms = 0.0;
    for (k, step) in steps.iter().enumerate() {
        let for_map = mapping.get(k);
        filter.predict(id, &step.motion, for_map.map(|m| &m.motion))?;
        let measured: Option<Vec<Measurement>> =
            for_map.map(|m| m.sightings.iter().map(|s| s.measurement).collect());
        filter.observe(id, &step.sightings, measured.as_deref())?;
        map_from_start = frame.follow(filter.positions());
        let (pose, covariance) = filter.pose(id).ok_or(RunError::NoRobot(robot))?;
        let pose = moved(&map_from_start, &pose);
        poses.push(pose);
        if k % every == 0 || k + 1 == steps.len() {
            let began = Instant::now();
            snapshots.push(Snapshot {
                time_s: step.time_s,
                step: k,
                map_from_start,
                pose,
                covariance: turned(&map_from_start, &covariance),
                landmarks: landmarks_in(&map_from_start, &filter),
            });
            snapshot_ms += began.elapsed().as_secs_f64() * 1e3;
        }
    }
    let filter_ms = began.elapsed().as_secs_f64() * 1e3 - snapshot_ms;
    let mut tally = Tally::default();
    steps.iter().zip(filter.verdicts()).for_each(|(step, verdicts)| tally.count(step, verdicts));
    tally.join(filter.best().joined());
    let (names, wrong) = tally.names();
    Ok(Run {
        robot: recorded.name.clone(),
        landmarks: landmarks_in(&map_from_start, &filter),
        wrong_associations: wrong.filter(|_| !labelled),
        names,
        noise,
        counts: tally.counts,
        nis_per_dof: tally.nis / tally.dof.max(1.0),
        nis_within_95: tally.within / tally.judged.max(1.0),
        recoveries: filter.recoveries(),
        filter_ms,
        began_s: recorded.entries.first().map_or(0.0, |e| e.time_s),
        times_s: steps.iter().map(|s| s.time_s).collect(),
        poses,
        snapshots,
    })
}

/// A pose in another frame.
fn moved(to: &Se2, pose: &Vector3<f64>) -> Vector3<f64> {
    let own = *to * Se2::from_xy_angle(pose.x, pose.y, pose.z);
    Vector3::new(own.translation.x, own.translation.y, own.rotation.log())
}

/// The covariance of a pose in another frame.
fn turned(to: &Se2, covariance: &Matrix3<f64>) -> Matrix3<f64> {
    let (s, c) = (to.rotation.sin(), to.rotation.cos());
    let turn = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
    turn * covariance * turn.transpose()
}

/// The landmarks in another frame.
fn landmarks_in(to: &Se2, filter: &Hypotheses) -> Vec<Landmark> {
    let (s, c) = (to.rotation.sin(), to.rotation.cos());
    let turn = Matrix2::new(c, -s, s, c);
    let moved = |l: Landmark| Landmark {
        position: *to * l.position,
        covariance: turn * l.covariance * turn.transpose(),
        ..l
    };
    filter.landmarks().into_iter().map(moved).collect()
}

#[derive(Default)]
struct Tally {
    counts: Counts,
    nis: f64,
    dof: f64,
    within: f64,
    judged: f64,
    /// Number of sightings of each landmark by label.
    votes: BTreeMap<LandmarkId, BTreeMap<u32, usize>>,
}

impl Tally {
    fn count(&mut self, step: &Step, verdicts: &[Verdict]) {
        for (sighting, verdict) in step.sightings.iter().zip(verdicts) {
            let landmark = match *verdict {
                Verdict::Taken { landmark, nis, dof } => {
                    self.counts.taken += 1;
                    self.nis += nis;
                    self.dof += dof as f64;
                    self.judged += 1.0;
                    // Cheap, since there are few degrees of freedom.
                    self.within += f64::from(u8::from(chi2::cumulative(nis, dof) <= 0.95));
                    landmark
                }
                Verdict::New { landmark } => {
                    self.counts.new += 1;
                    Some(landmark)
                }
                Verdict::Rejected { .. } | Verdict::Ambiguous { .. } => {
                    self.counts.rejected += 1;
                    self.judged += 1.0;
                    None
                }
                Verdict::Waiting { .. } | Verdict::Unusable => {
                    self.counts.waiting += 1;
                    None
                }
            };
            if let (Some(landmark), Target::Landmark(label)) = (landmark, sighting.target) {
                *self.votes.entry(landmark).or_default().entry(label).or_default() += 1;
            }
        }
    }

    /// Adds up the votes of landmarks that were merged.
    fn join(&mut self, joined: &BTreeMap<LandmarkId, LandmarkId>) {
        for id in joined.keys() {
            let mut to = *id;
            while let Some(next) = joined.get(&to) {
                to = *next;
            }
            for (label, n) in self.votes.remove(id).unwrap_or_default() {
                *self.votes.entry(to).or_default().entry(label).or_default() += n;
            }
        }
    }

    /// The most frequent label of each landmark, and the fraction of sightings with another label.
    fn names(&self) -> (BTreeMap<LandmarkId, u32>, Option<f64>) {
        let (mut names, mut right, mut all) = (BTreeMap::new(), 0, 0);
        for (id, votes) in &self.votes {
            if let Some((label, most)) = votes.iter().max_by_key(|(_, n)| **n) {
                names.insert(*id, *label);
                right += most;
                all += votes.values().sum::<usize>();
            }
        }
        (names, (all > 0).then(|| 1.0 - f64::from(right as u32) / f64::from(all as u32)))
    }
}

impl Run {
    /// Confirmed landmarks by label; of several with one label the one seen most often.
    pub fn named(&self) -> BTreeMap<u32, Vec2> {
        let mut best: BTreeMap<u32, (usize, Vec2)> = BTreeMap::new();
        for landmark in self.landmarks.iter().filter(|l| l.confirmed) {
            let Some(name) = landmark.label.or_else(|| self.names.get(&landmark.id).copied()) else {
                continue;
            };
            let entry = best.entry(name).or_insert((0, landmark.position));
            if landmark.seen > entry.0 {
                *entry = (landmark.seen, landmark.position);
            }
        }
        best.into_iter().map(|(name, (_, position))| (name, position)).collect()
    }

    /// Smooths the whole run with the log's smoothing noise, starting from the filter's estimates. Sightings are
    /// associated by their labels.
    ///
    /// # Errors
    /// As [`run`].
    pub fn smoothed(
        &self,
        log: &Log,
        robot: usize,
        config: &BatchConfig,
    ) -> Result<(Smoothed, BatchReport), RunError> {
        let recorded = log.robots.get(robot).ok_or(RunError::NoRobot(robot))?;
        let for_smoothing = if log.noise_known { log.smoothing_noise } else { self.noise };
        // The delay is the same, so that the steps have the same instants.
        let noise = Noise { sighting_delay_s: log.noise.sighting_delay_s, ..for_smoothing };
        let mut steps = recorded.steps(&noise, &[])?;
        steps.iter_mut().for_each(|s| s.sightings.retain(|s| !matches!(s.target, Target::Robot(_))));
        let start = Smoothed { poses: vec![self.poses.clone()], landmarks: self.named() };
        Ok(smooth(&[steps], start, config))
    }
}

/// Aligns landmarks with others of the same labels, without scaling: returns the transform onto `target`, the root mean
/// square of the residuals in metres, and the number of pairs. `None` for fewer than three pairs or collinear pairs.
pub fn align(target: &BTreeMap<u32, Vec2>, source: &BTreeMap<u32, Vec2>) -> Option<(Se2, f64, usize)> {
    let pairs: Vec<(Vec3, Vec3)> =
        source.iter().filter_map(|(name, p)| Some((target.get(name)?.push(0.0), p.push(0.0)))).collect();
    let (to, from): (Vec<Vec3>, Vec<Vec3>) = pairs.into_iter().unzip();
    let found = umeyama(&to, &from, false).ok()?;
    let x = found.rotation * Vec3::x();
    let transform = Se2::from_xy_angle(found.translation.x, found.translation.y, x.y.atan2(x.x));
    let sum: f64 = to.iter().zip(&from).map(|(t, f)| (t.xy() - transform * f.xy()).norm_squared()).sum();
    Some((transform, (sum / to.len() as f64).sqrt(), to.len()))
}

/// Root mean square distance of positions in metres, after each list is transformed by its own transform.
pub fn position_rmse(a: &[Vector3<f64>], a_to: &Se2, b: &[Vector3<f64>], b_to: &Se2) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(a, b)| (*a_to * a.xy() - *b_to * b.xy()).norm_squared()).sum();
    (sum / a.len().min(b.len()).max(1) as f64).sqrt()
}

/// Half axes (m) and direction (rad) of the ellipse that contains 95 % of a Gaussian in the plane.
pub fn ellipse_95(covariance: &Matrix2<f64>) -> [f64; 3] {
    let (a, b, c) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
    let (mean, half) = (0.5 * (a + c), (0.25 * (a - c) * (a - c) + b * b).sqrt());
    let scale = chi2::quantile(0.95, 2);
    let axis = |variance: f64| (scale * variance.max(0.0)).sqrt();
    [axis(mean + half), axis(mean - half), 0.5 * (2.0 * b).atan2(a - c)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn alignment_undoes_a_rigid_motion() {
        let moved = Se2::from_xy_angle(3.0, -1.0, 2.5);
        let source: BTreeMap<u32, Vec2> =
            (0..6).map(|k| (k, Vec2::new(f64::from(k), f64::from(k * k)))).collect();
        let target: BTreeMap<u32, Vec2> = source.iter().map(|(k, p)| (*k, moved * *p)).collect();
        let (transform, rmse, pairs) = align(&target, &source).unwrap();
        assert!(rmse < 1e-12 && pairs == 6 && (transform.inverse() * moved).translation.norm() < 1e-12);
        assert!(align(&target, &BTreeMap::new()).is_none());
    }

    #[test]
    fn ellipses_have_the_axes_of_their_covariance() {
        let [long, short, angle] = ellipse_95(&Matrix2::new(1.0, 0.0, 0.0, 4.0));
        let k = 5.991_465_f64.sqrt();
        assert!((long - 2.0 * k).abs() < 1e-5 && (short - k).abs() < 1e-5);
        assert!((angle.abs() - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    }
}
