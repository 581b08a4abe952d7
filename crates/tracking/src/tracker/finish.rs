//! The final pose of a frame from the local map, whether to believe it, and whether the frame becomes a key frame.

use super::locator::{Candidate, Seed};
use super::static_landmarks::is_confirmed_before;
use super::{BRIDGE_S, Miss, Now, Tracker};
use crate::decide::{Situation, wants_key_frame};
use crate::match_last::Matches;
use crate::mode::Mode;
use crate::priors::Correction;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, Last, State, Tracked, anchored_at};
use cairn_atlas::{KeyFrameId, LandmarkId};
use cairn_geometry::Se3;
use nalgebra::Matrix6;
use std::collections::BTreeSet;

/// A pose by features that is believed.
pub(super) struct Located {
    candidate: Candidate,
    anchored: AnchoredPose,
    covariance: Option<Matrix6<f64>>,
}

impl Tracker {
    /// Matches with the local map and optimises the pose.
    pub(super) fn locate(&mut self, now: &Now, (guess, matches): (Se3, Matches)) -> Result<Candidate, Miss> {
        let newest = now.snapshot.newest_key_frame().ok_or(Miss { inliers: 0, is_final: true })?.id;
        let last = self.last.as_ref();
        let prior = self.priors.prior(last, now.frame.stamp);
        let seed = Seed {
            guess,
            matches,
            fallback: last.and_then(|last| last.reference(now.snapshot)).unwrap_or(newest),
            prior: prior.or_else(|| self.unit.parallax.position_prior(now.snapshot, &guess)),
            since_recovery: self.clock.since_recovery,
        };
        // Readings that lead elsewhere than the matches are a witness, not the judge.
        let without = self.priors.is_predicted_by_readings().then(|| Seed { prior: None, ..seed.clone() });
        let mut candidate = self.locator.in_local_map(now.frame, now.snapshot, seed);
        if let Some(without) = without.filter(|_| self.priors.readings_contradict(&candidate)) {
            let alone = self.locator.in_local_map(now.frame, now.snapshot, without);
            if alone.located.inliers >= alone.need {
                self.priors.disregard_readings();
                candidate = alone;
            }
        }
        let inliers = candidate.located.inliers;
        if inliers < candidate.need { Err(Miss { inliers, is_final: false }) } else { Ok(candidate) }
    }

    /// Readings of the IMU that lead nowhere from a frame that was tracked may be wrong: the same without them. Where that leads nowhere
    /// either, they go on with the pose.
    pub(super) fn find_without_readings(&mut self, now: &Now, miss: Miss) -> Result<Located, Miss> {
        let may_be = !miss.is_final && self.clock.is_recent(now.frame.stamp, BRIDGE_S);
        let by_readings = may_be.then(|| self.priors.set_aside_readings()).flatten();
        let Some(by_readings) = by_readings else { return Err(miss) };
        let matches = self.by_motion(now).or_else(|| self.by_reference(now));
        let found = matches.ok_or(Miss { inliers: 0, is_final: false });
        let found = found.and_then(|matches| self.locate(now, matches));
        found.and_then(|candidate| self.check(now, candidate)).map_err(|_| {
            self.priors.put_back(by_readings);
            miss
        })
    }

    /// Whether the pose by features can be that of the camera, by all else that is known of it.
    pub(super) fn check(&mut self, now: &Now, candidate: Candidate) -> Result<Located, Miss> {
        let (inliers, pose) = (candidate.located.inliers, candidate.located.world_from_camera);
        let (last, stamp) = (self.last.as_ref(), now.frame.stamp);
        let agrees = || self.priors.is_front_end() || self.priors.agrees(now.snapshot, last, stamp, &pose);
        if self.contradicts_readings(now, &candidate) || !agrees() {
            return Err(Miss { inliers, is_final: false });
        }
        let (chosen, covariance) = self.priors.chosen(&candidate.located);
        match self.locator.anchor_nearest(now.snapshot, candidate.fallback, chosen) {
            Some(anchored) => Ok(Located { candidate, anchored, covariance }),
            None => Err(Miss { inliers, is_final: true }),
        }
    }

    /// Whether a pose cannot be that to which the readings alone have led since the map was seen last. Landmarks that were made on
    /// the way cannot tell that the camera is elsewhere. Landmarks that were confirmed before can, and are believed.
    fn contradicts_readings(&self, now: &Now, candidate: &Candidate) -> bool {
        let since = self
            .priors
            .inertial
            .as_ref()
            .zip(candidate.prior.as_ref())
            .and_then(|(inertial, prior)| inertial.contradicted_since(&candidate.located, prior));
        let Some(since) = since else { return false };
        let landmarks = candidate.matches.landmarks.iter().flatten();
        let landmarks = landmarks.filter_map(|id| now.snapshot.landmark(*id));
        let before = landmarks.filter(|l| is_confirmed_before(now.snapshot, l, since)).count();
        before < self.setup.need(now.frame)
    }

    /// Takes over the pose of a frame, and decides whether it becomes a key frame.
    pub(super) fn accept(&mut self, now: &Now, found: Located) -> Tracked {
        let Located { candidate, anchored, covariance } = found;
        self.settle(now, &candidate, anchored);
        let request = self.request_key_frame(now, &candidate, anchored);
        let Candidate { matches, expected, matched, located, .. } = candidate;
        let seen: BTreeSet<LandmarkId> = matches.landmarks.iter().flatten().copied().collect();
        let (features, inliers) = (now.frame.len(), located.inliers);
        let evidence = Evidence { features, expected: expected.len(), matched, inliers };
        self.last = Some(Last { frame: now.frame.clone(), landmarks: matches.landmarks, anchored });
        Tracked {
            pose: Some(anchored),
            covariance,
            request,
            scale_supported: self.unit.is_supported(),
            seen: expected.into_iter().map(|id| (id, seen.contains(&id))).collect(),
            ..Tracked::without_pose(now.frame.stamp, State::Tracking, evidence)
        }
    }

    /// Tells everybody the pose.
    fn settle(&mut self, now: &Now, candidate: &Candidate, anchored: AnchoredPose) {
        let (frame, snapshot, stamp) = (now.frame, now.snapshot, now.frame.stamp);
        let before = self.last.as_ref();
        let before = before.filter(|l| self.clock.is_recent(stamp, BRIDGE_S) && stamp > l.frame.stamp);
        let before = before.map(|l| (l.anchored.world_from_camera, stamp - l.frame.stamp));
        let (located, prior) = (&candidate.located, candidate.prior.as_ref());
        self.priors.correct(&Correction { snapshot, stamp, anchored: &anchored, before, located, prior });
        self.unit.located(frame, snapshot, &candidate.matches, anchored, before);
        self.mode = Mode::Tracking;
        self.clock.located = Some(stamp);
    }

    /// Asks for a key frame where one is due.
    fn request_key_frame(
        &mut self,
        now: &Now,
        candidate: &Candidate,
        anchored: AnchoredPose,
    ) -> Option<KeyFrameRequest> {
        let Now { frame, snapshot, idle } = *now;
        let reference: KeyFrameId = self.locator.reference().unwrap_or(candidate.fallback);
        let filter = self.priors.inertial.as_ref().map(|inertial| &inertial.filter);
        let situation = Situation {
            snapshot,
            camera: &self.setup.camera,
            frame,
            matches: &candidate.matches,
            inliers: candidate.located.inliers,
            need: candidate.need,
            reference,
            rotated_rad: anchored.reference_from_camera.rotation.angle(),
            since: self.clock.since_key_frame,
            stationary: filter.is_some_and(|i| i.is_stationary(frame.stamp)),
            since_s: filter.and_then(|i| i.seconds_since_request(frame.stamp)),
            idle,
        };
        if !wants_key_frame(&situation, self.setup.rate_hz) {
            return None;
        }
        self.clock.since_key_frame = 0;
        Some(KeyFrameRequest::Next {
            frame: frame.clone(),
            landmarks: candidate.matches.landmarks.clone(),
            anchored: anchored_at(snapshot, reference, anchored.world_from_camera).unwrap_or(anchored),
            imu: self.priors.take_segment(frame.stamp),
            orientation_only: self.unit.is_depthless(),
            rescale: self.unit.due_rescale(snapshot, reference),
            motion: None,
            by_depth: self.priors.is_front_end(),
        })
    }
}
