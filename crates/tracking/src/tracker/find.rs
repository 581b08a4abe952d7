//! The first pose of a frame: by the motion model, by the reference key frame, or by relocalisation.

use super::Tracker;
use crate::match_last::{Before, Matches, match_last};
use crate::recover::{candidates, match_key_frame};
use crate::state::Last;
use cairn_adjust::{Located, RecogniseConfig, View, locate, recognise};
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_inertial::NavEstimate;
use cairn_solve::PosePrior;
use cairn_vision::Frame;
use std::collections::BTreeSet;

/// Needed to relocalise: seed matches by appearance that agree, and the share of expected landmarks that
/// agree in the end.
pub(super) const RECOGNISE_SEED: usize = 12;
pub(super) const RECOGNISE_SHARE: f64 = 0.4;

impl Tracker {
    pub(super) fn locate(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        matches: &mut Matches,
    ) -> Located {
        self.locate_from(snapshot, frame, guess, None, matches)
    }

    pub(super) fn locate_from(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &mut Matches,
    ) -> Located {
        let located = locate(snapshot, &self.camera, frame, guess, &matches.landmarks, &matches.extra, prior);
        let located = self.gated(snapshot, frame, guess, prior, matches, located);
        matches.drop_outliers(&located.outliers);
        located
    }

    /// Predicts by the IMU, else by a measured motion, else by constant velocity (with the gyroscope's rotation, where there is
    /// one), else by the last pose, and matches around that.
    pub(crate) fn by_motion(
        &self,
        frame: &Frame,
        snapshot: &Snapshot,
        predicted: Option<&NavEstimate>,
    ) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let elapsed = frame.stamp - last.frame.stamp;
        let mut moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * elapsed)));
        if let Some(turned) = self.inertial.as_ref().and_then(|i| i.turned(last.frame.stamp, frame.stamp)) {
            moved.rotation = turned;
        }
        let reckoned = self.reckoned().map(|r| r.world_from_camera);
        let guess = predicted.map(|b| b.world_from_camera).or(reckoned);
        let guess = guess.unwrap_or(last.anchored.world_from_camera * moved);
        self.match_from(last, &guess, frame, snapshot)
    }

    /// The same without the prediction, where that led nowhere although the frame before was tracked: readings may be wrong.
    pub(crate) fn by_own_motion(
        &self,
        frame: &Frame,
        snapshot: &Snapshot,
        predicted: Option<&NavEstimate>,
    ) -> Option<(Se3, Matches)> {
        let was_tracked = self.inertial.as_ref().is_some_and(|i| i.carried_since().is_none());
        predicted.filter(|_| was_tracked)?;
        self.by_motion(frame, snapshot, None)
    }

    /// Matches with the previous frame around a guess, and farther out where the guess was poor.
    pub(super) fn match_from(
        &self,
        last: &Last,
        guess: &Se3,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(Se3, Matches)> {
        let mut guess = *guess;
        let radius = if self.camera.has_depth() { 7.0 } else { 15.0 };
        let known = last.landmarks.iter().flatten().count();
        let before = Before {
            frame: &last.frame,
            landmarks: &last.landmarks,
            world_from_camera: last.anchored.world_from_camera,
        };
        let few = self.need(frame).min(15);
        let mut best: Option<(usize, Se3, Matches)> = None;
        // A good prediction finds most of what was seen; else search farther, then closely around the
        // resulting pose.
        for radius in [radius, 2.0 * radius, 4.0 * radius, radius] {
            let mut matches = match_last(snapshot, &self.camera, &before, frame, &guess, radius);
            if matches.count() < few {
                continue;
            }
            let located = self.locate(snapshot, frame, &guess, &mut matches);
            if located.inliers >= few.min(12) && best.as_ref().is_none_or(|(n, ..)| located.inliers > *n) {
                guess = located.world_from_camera;
                best = Some((located.inliers, located.world_from_camera, matches));
            }
            if located.inliers * 2 >= known.max(24) {
                break;
            }
        }
        best.map(|(_, pose, matches)| (pose, matches))
    }

    /// Matches by the descriptors of the reference key frame, near the last pose.
    pub(crate) fn by_reference(&self, frame: &Frame, snapshot: &Snapshot) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
        let mut matches = match_key_frame(snapshot.key_frame(reference)?, frame, 0.7);
        if matches.count() < 15 {
            return None;
        }
        let located = self.locate(snapshot, frame, &last.anchored.world_from_camera, &mut matches);
        (located.inliers >= 12).then_some((located.world_from_camera, matches))
    }

    /// Relocalises among earlier key frames; the best inlier count when no place is recognised.
    pub(super) fn relocalise(&mut self, frame: &Frame, snapshot: &Snapshot) -> Result<(Se3, Matches), usize> {
        let last = self.last.as_ref().map(|l| l.anchored.world_from_camera.translation);
        let config =
            RecogniseConfig { seed: RECOGNISE_SEED, need: self.config.min_inliers, share: RECOGNISE_SHARE };
        let mut best = 0;
        for id in candidates(snapshot, &self.camera, frame, last, self.lost_frames) {
            let view = View::new(&self.camera, frame);
            match recognise(snapshot, &view, id, &BTreeSet::new(), &config, frame.stamp.0 as u64) {
                Ok(place) if !self.reaches(snapshot, id, &place.world_from_camera, frame.stamp) => {}
                Ok(place) => {
                    let matches = Matches { landmarks: place.landmarks, extra: Vec::new() };
                    return Ok((place.world_from_camera, matches));
                }
                Err(why) => best = best.max(why.agreed()),
            }
        }
        Err(best)
    }
}
