//! The first pose of a frame: by what predicts its motion, by the reference key frame, or by relocalisation.

use super::{BRIDGE_S, Miss, Now, Tracker};
use crate::match_last::Matches;
use crate::recover::{RECOGNISE_SEED, RECOGNISE_SHARE, candidates};
use crate::state::map_of;
use cairn_adjust::{RecogniseConfig, View, recognise};
use cairn_geometry::Se3;
use std::collections::BTreeSet;

impl Tracker {
    /// Matches a frame around where it must be: by the motion priors, by the reference key frame, or by relocalisation.
    pub(super) fn match_features(&mut self, now: &Now) -> Result<(Se3, Matches), Miss> {
        let stamp = now.frame.stamp;
        if let Some(hinted) = self.by_hint(now) {
            self.clock.since_recovery = 0;
            self.priors.disregard();
            return Ok(hinted);
        }
        let sure = self.priors.sure(self.last.as_ref(), stamp);
        // A short gap is bridged by the motion model; after a longer one only appearance can find the pose.
        let is_bridged = !self.mode.is_lost() || self.clock.is_recent(stamp, BRIDGE_S) || sure.is_some();
        let first = is_bridged.then(|| self.by_motion(now).or_else(|| self.by_reference(now))).flatten();
        if let Some((pose, matches)) = &first
            && self.contradicts_depth(pose, matches)
        {
            self.priors.refuse_depth(stamp);
        }
        let (guess, matches, is_found_again) = match (first, sure) {
            (Some((pose, matches)), _) => (pose, matches, false),
            // The prediction is accurate enough to search for the map around it.
            (None, Some(pose)) => (pose, Matches::none(now.frame), false),
            (None, None) => {
                let (pose, matches) = self.relocalise(now)?;
                (pose, matches, true)
            }
        };
        let regained = self.unit.regain(now.frame, now.snapshot, self.last.as_ref(), &guess);
        if is_found_again || regained.is_some() {
            self.clock.since_recovery = 0;
            self.priors.disregard();
        }
        Ok(regained.unwrap_or((guess, matches)))
    }

    /// Predicts the pose by the motion priors, and matches around that.
    pub(crate) fn by_motion(&self, now: &Now) -> Option<(Se3, Matches)> {
        let last = self.last.as_ref()?;
        let guess = self.priors.predict(Some(last), now.frame.stamp)?;
        self.locator.match_from(last, &guess, now.frame, now.snapshot)
    }

    /// Matches by the descriptors of the reference key frame, near the last pose.
    pub(crate) fn by_reference(&self, now: &Now) -> Option<(Se3, Matches)> {
        self.locator.by_reference(self.last.as_ref()?, now.frame, now.snapshot)
    }

    /// Whether features that suffice by themselves contradict the depth, where that only helps them out.
    pub(crate) fn contradicts_depth(&self, pose: &Se3, matches: &Matches) -> bool {
        let enough = self.setup.config.min_inliers;
        self.priors.depth.as_ref().is_some_and(|depth| depth.is_contradicted(pose, matches, enough))
    }

    /// Recognises the place where the camera is said to be. Where tracking goes on in the same map, the motion since the frame before
    /// is not known.
    fn by_hint(&mut self, now: &Now) -> Option<(Se3, Matches)> {
        let (snapshot, frame) = (now.snapshot, now.frame);
        let last = self.last.as_ref().filter(|_| !self.mode.is_lost());
        let at = last.map(|last| last.anchored);
        let at = at.and_then(|at| Some((map_of(snapshot, at.reference)?, at.world_from_camera)));
        let config = self.to_recognise();
        let candidates = self.hinted.candidates(snapshot, &self.setup.camera, frame, at, config.need);
        for id in candidates {
            let view = View::new(&self.setup.camera, frame);
            match recognise(snapshot, &view, id, &BTreeSet::new(), &config, frame.stamp.0 as u64) {
                Ok(place) if self.hinted.allows(map_of(snapshot, id), &place.world_from_camera) => {
                    self.hinted.confirm();
                    if at.is_some_and(|(map, _)| Some(map) == map_of(snapshot, id)) {
                        self.odometry.miss();
                    }
                    let matches = Matches { landmarks: place.landmarks, extra: Vec::new() };
                    return Some((place.world_from_camera, matches));
                }
                Ok(_) => {}
                Err(why) => self.hinted.tried(why.agreed()),
            }
        }
        None
    }

    fn to_recognise(&self) -> RecogniseConfig {
        let need = self.setup.config.min_inliers;
        RecogniseConfig { seed: RECOGNISE_SEED, need, share: RECOGNISE_SHARE }
    }

    /// Relocalises among earlier key frames; the best inlier count when no place is recognised.
    fn relocalise(&self, now: &Now) -> Result<(Se3, Matches), Miss> {
        let (snapshot, frame) = (now.snapshot, now.frame);
        let last = self.last.as_ref();
        let before = last.map(|l| l.anchored.world_from_camera.translation);
        let config = self.to_recognise();
        let mut best = 0;
        for id in candidates(snapshot, &self.setup.camera, frame, before, self.mode.missed()) {
            let view = View::new(&self.setup.camera, frame);
            match recognise(snapshot, &view, id, &BTreeSet::new(), &config, frame.stamp.0 as u64) {
                Ok(place)
                    if !self.unit.reaches(snapshot, last, id, &place.world_from_camera, frame.stamp)
                        || !self.hinted.allows(map_of(snapshot, id), &place.world_from_camera) => {}
                Ok(place) => {
                    let matches = Matches { landmarks: place.landmarks, extra: Vec::new() };
                    return Ok((place.world_from_camera, matches));
                }
                Err(why) => best = best.max(why.agreed()),
            }
        }
        Err(Miss { inliers: best, is_final: false })
    }
}
