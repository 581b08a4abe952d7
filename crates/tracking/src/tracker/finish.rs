//! The final pose of a frame from the local map, and whether it becomes a key frame.

use super::static_landmarks::is_confirmed_before;
use super::{BRIDGE_S, Tracker};
use crate::decide::{Situation, wants_key_frame};
use crate::match_last::Matches;
use crate::reckoning::{Reckoned, tracked_covariance};
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, Last, State, Tracked, anchored_at};
use cairn_adjust::Located;
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::{Manifold, Se3};
use cairn_inertial::NavEstimate;
use cairn_solve::PosePrior;
use cairn_vision::Frame;
use nalgebra::Matrix6;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Inlier matches needed where the IMU constrains the pose too.
const MIN_INLIERS_WITH_IMU: usize = 15;

/// A frame located in the local map.
struct Found {
    located: Located,
    matches: Matches,
    /// Landmarks that should be in view.
    expected: Vec<LandmarkId>,
    /// Matches before outliers were dropped.
    matched: usize,
    /// Inlier matches that were required.
    need: usize,
}

impl Tracker {
    /// Matches with the local map, optimises the pose and decides whether the frame becomes a key frame.
    pub(super) fn finish(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
        guess: Se3,
        matches: Matches,
        mut predicted: Option<NavEstimate>,
        idle: bool,
    ) -> Tracked {
        let Some(newest) = snapshot.newest_key_frame().map(|k| k.id) else { return self.lose(frame, 0) };
        let last = self.last.as_ref();
        let fallback =
            last.and_then(|l| snapshot.surviving_ancestor(l.anchored.reference)).map_or(newest, |(id, _)| id);
        let (mut prior, reckoned) = self.prior(snapshot, &guess, predicted.as_ref());
        let is_carried = self.inertial.as_ref().is_some_and(|i| i.carried_since().is_some());
        let before = (predicted.is_some() && !is_carried).then(|| matches.clone());
        let mut found = self.in_local_map(&frame, snapshot, &guess, matches, prior.as_ref(), fallback);
        if let Some(before) =
            before.filter(|_| contradicts(&found.located, prior.as_ref(), predicted.as_ref()))
            && let Some(alone) = self.by_sight_alone(&frame, snapshot, &guess, before, fallback)
        {
            (found, prior, predicted) = (alone, None, None);
        }
        let (world_from_camera, inliers) = (found.located.world_from_camera, found.located.inliers);
        if inliers < found.need {
            return self.miss(frame, snapshot, inliers, predicted, idle);
        }
        if self.contradicts_carried(&frame, snapshot, &found, prior.as_ref(), predicted.as_ref()) {
            return self.miss(frame, snapshot, inliers, predicted, idle);
        }
        let is_front_end = self.dense.as_ref().is_some_and(|dense| dense.is_front_end());
        let is_reckoned = reckoned.is_none_or(|r| r.agrees(&world_from_camera))
            && self.agrees_since_request(snapshot, &world_from_camera);
        if !is_front_end && !is_reckoned {
            return self.miss(frame, snapshot, inliers, predicted, idle);
        }
        let chosen = self.dense.as_ref().map_or(world_from_camera, |dense| dense.chosen(world_from_camera));
        let Some(anchored) = self.anchor_nearest(snapshot, fallback, chosen) else {
            return self.lose(frame, inliers);
        };
        let by_depth = self.dense.as_ref().filter(|_| is_front_end).and_then(|dense| dense.aligned());
        let covariance = match by_depth {
            Some(aligned) => Some(aligned.reckoned.covariance),
            None => found.located.information.try_inverse(),
        };
        self.tell_inertial(&frame, snapshot, &found.located, &anchored, prior.as_ref(), predicted.as_ref());
        self.settle(&frame, snapshot, &found.matches, anchored);
        let reference = self.local.reference.unwrap_or(fallback);
        let request = self.request_key_frame(&frame, snapshot, &found, reference, anchored, idle);
        let Found { matches, expected, matched, .. } = found;
        let seen: BTreeSet<LandmarkId> = matches.landmarks.iter().flatten().copied().collect();
        let evidence = Evidence { features: frame.len(), expected: expected.len(), matched, inliers };
        let stamp = frame.stamp;
        self.last = Some(Last { frame, landmarks: matches.landmarks, anchored });
        self.reckoning.restart(true);
        Tracked {
            stamp,
            state: State::Tracking,
            pose: Some(anchored),
            covariance,
            evidence,
            request,
            earlier: Vec::new(),
            scale_supported: self.is_scale_supported(),
            seen: expected.into_iter().map(|id| (id, seen.contains(&id))).collect(),
        }
    }

    /// What is known of the pose without the matches: from the IMU, else from a measured motion, else that a camera that
    /// turns on the spot keeps its position; with the measured motion.
    fn prior(
        &self,
        snapshot: &Snapshot,
        guess: &Se3,
        predicted: Option<&NavEstimate>,
    ) -> (Option<PosePrior>, Option<Reckoned>) {
        let prior = predicted.and_then(|b| {
            Some(PosePrior { world_from_camera: b.world_from_camera, information: b.pose_information()? })
        });
        let reckoned = self.reckoned().filter(|r| prior.is_none() && r.may_coast());
        // Where the pose is that of the depth, features say what they see by themselves.
        let is_front_end = self.dense.as_ref().is_some_and(|dense| dense.is_front_end());
        let prior = prior.or(reckoned.filter(|_| !is_front_end).map(|r| r.prior()));
        (prior.or_else(|| self.parallax.position_prior(snapshot, guess)), reckoned)
    }

    /// Locates a frame in the local map around its matches, twice where the guess was poor.
    fn in_local_map(
        &mut self,
        frame: &Frame,
        snapshot: &Snapshot,
        guess: &Se3,
        mut matches: Matches,
        prior: Option<&PosePrior>,
        fallback: KeyFrameId,
    ) -> Found {
        matches.extra.clear();
        self.local.gather(snapshot, &matches, fallback, self.config.local_key_frames);
        let factor = match self.since_recovery {
            0..=2 => 5.0,
            _ if matches.count() == 0 => 5.0,
            _ => 1.0,
        };
        let mut expected = self.local.search(snapshot, &self.camera, frame, guess, factor, &mut matches);
        let mut matched = matches.count();
        let mut located = self.locate_from(snapshot, frame, guess, prior, &mut matches);
        // Few of the expected landmarks were found: the guess was poor. Search again from the better pose.
        if located.inliers * 3 < expected.len() {
            let better = located.world_from_camera;
            expected = self.local.search(snapshot, &self.camera, frame, &better, 1.0, &mut matches);
            matched = matches.count();
            located = self.locate_from(snapshot, frame, &better, prior, &mut matches);
        }
        let need = match (prior, self.since_recovery < 30) {
            // The prior constrains the pose too: from the IMU, or that the camera turns on the spot.
            (Some(_), _) => self.need(frame).min(MIN_INLIERS_WITH_IMU),
            (None, true) => self.recovered_need(),
            (None, false) => self.need(frame),
        };
        Found { located, matches, expected, matched, need }
    }

    /// The pose by the matches alone, where they suffice: readings that lead elsewhere are a witness, not the judge.
    fn by_sight_alone(
        &mut self,
        frame: &Frame,
        snapshot: &Snapshot,
        guess: &Se3,
        matches: Matches,
        fallback: KeyFrameId,
    ) -> Option<Found> {
        let found = self.in_local_map(frame, snapshot, guess, matches, None, fallback);
        (found.located.inliers >= found.need).then_some(found)
    }

    /// Whether a pose cannot be that to which the readings alone have led since the map was seen last. Landmarks that were made
    /// on the way there are where that estimate put them; they cannot tell that it is elsewhere. Landmarks that were confirmed before
    /// can, and are believed. The estimate becomes uncertain as the walker goes on, so that nobody is shut out for good.
    fn contradicts_carried(
        &self,
        frame: &Frame,
        snapshot: &Snapshot,
        found: &Found,
        prior: Option<&PosePrior>,
        predicted: Option<&NavEstimate>,
    ) -> bool {
        let since = self.inertial.as_ref().and_then(|i| i.carried_since());
        let (Some(since), Some(prior), Some(predicted)) = (since, prior, predicted) else { return false };
        let landmarks = found.matches.landmarks.iter().flatten().filter_map(|id| snapshot.landmark(*id));
        let before = landmarks.filter(|l| is_confirmed_before(snapshot, l, since)).count();
        before < self.need(frame) && contradicts(&found.located, Some(prior), Some(predicted))
    }

    /// Gives the pose to the inertial filter.
    fn tell_inertial(
        &mut self,
        frame: &Frame,
        snapshot: &Snapshot,
        located: &Located,
        anchored: &AnchoredPose,
        prior: Option<&PosePrior>,
        predicted: Option<&NavEstimate>,
    ) {
        let Some(inertial) = &mut self.inertial else { return };
        // The IMU prior is part of the pose; the time offset and the readings must be judged by vision alone.
        let alone = prior.and_then(|p| without_prior(located, p));
        let alone = alone.map_or(anchored.world_from_camera, |(alone, _)| alone);
        if inertial.wants_rotations(frame.stamp) {
            inertial.add_rotation(frame.stamp, alone.rotation);
        }
        let alone = anchored_at(snapshot, anchored.reference, alone).unwrap_or(*anchored);
        let fails = inertial.see(snapshot, frame.stamp, &alone);
        let predicted = predicted.filter(|_| !fails);
        inertial.update(snapshot, frame.stamp, anchored, predicted, &located.information);
    }

    /// Takes over the pose: velocity, walking speed, unit of length.
    fn settle(&mut self, frame: &Arc<Frame>, snapshot: &Snapshot, matches: &Matches, anchored: AnchoredPose) {
        let world_from_camera = &anchored.world_from_camera;
        let before =
            self.last.as_ref().filter(|last| self.recent(frame, BRIDGE_S) && frame.stamp > last.frame.stamp);
        let since = before.map(|last| (last.anchored.world_from_camera, frame.stamp - last.frame.stamp));
        self.velocity = since.map(|(before, elapsed_s)| before.local(world_from_camera) / elapsed_s);
        match since.filter(|_| !self.scale_support.is_lost()) {
            Some((before, elapsed_s)) => {
                self.pace.moved(world_from_camera.translation - before.translation, elapsed_s);
            }
            None => self.pace.interrupt(),
        }
        self.unit = snapshot.world_from_here(anchored.reference).map(|here| (anchored.reference, here.scale));
        self.watch_scale(frame, snapshot, matches, anchored);
        self.lost = false;
        self.lost_frames = 0;
        self.located = Some(frame.stamp);
    }

    /// Asks for a key frame where one is due.
    fn request_key_frame(
        &mut self,
        frame: &Arc<Frame>,
        snapshot: &Snapshot,
        found: &Found,
        reference: KeyFrameId,
        anchored: AnchoredPose,
        idle: bool,
    ) -> Option<KeyFrameRequest> {
        let situation = Situation {
            snapshot,
            camera: &self.camera,
            frame,
            matches: &found.matches,
            inliers: found.located.inliers,
            need: found.need,
            reference,
            rotated_rad: anchored.reference_from_camera.rotation.angle(),
            since: self.since_key_frame,
            stationary: self.inertial.as_ref().is_some_and(|i| i.is_stationary(frame.stamp)),
            since_s: self.inertial.as_ref().and_then(|i| i.seconds_since_request(frame.stamp)),
            idle,
        };
        if !wants_key_frame(&situation, self.rate_hz, self.config.min_key_frame_gap) {
            return None;
        }
        self.since_key_frame = 0;
        Some(KeyFrameRequest::Next {
            frame: frame.clone(),
            landmarks: found.matches.landmarks.clone(),
            anchored: anchored_at(snapshot, reference, anchored.world_from_camera).unwrap_or(anchored),
            imu: self.inertial.as_mut().map(|i| i.take_segment(frame.stamp)),
            orientation_only: self.scale_support.is_lost() || self.parallax.is_turning(),
            rescale: self.due_rescale(snapshot, reference),
            motion: None,
        })
    }
}

/// Whether the matches lead elsewhere than the readings do.
fn contradicts(located: &Located, prior: Option<&PosePrior>, predicted: Option<&NavEstimate>) -> bool {
    let (Some(prior), Some(predicted)) = (prior, predicted) else { return false };
    let Some((alone, own)) = without_prior(located, prior) else { return false };
    let covariance = predicted.pose_covariance() + own + tracked_covariance();
    let world_from_camera = predicted.world_from_camera;
    !Reckoned { world_from_camera, covariance, limit: [f64::INFINITY; 2] }.agrees(&alone)
}

/// The pose without the prior, and its covariance: at the solution the gradients of the prior and of the observations cancel.
fn without_prior(located: &Located, prior: &PosePrior) -> Option<(Se3, Matrix6<f64>)> {
    let gradient = prior.information * prior.world_from_camera.local(&located.world_from_camera);
    let own = (located.information - prior.information).cholesky()?;
    Some((located.world_from_camera.retract(&own.solve(&gradient)), own.inverse()))
}
