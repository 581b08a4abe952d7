//! Locating a frame among landmarks: matching around a guess, in the last frame, in a key frame or in the local map, and the pose
//! that agrees with most of the matches.

use super::static_landmarks::gated;
use crate::local_map::LocalMap;
use crate::match_last::{Before, Matches, match_last};
use crate::recover::match_key_frame;
use crate::setup::Setup;
use crate::state::{AnchoredPose, Last, anchored_at};
use cairn_adjust::{Located, locate};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Se3;
use cairn_solve::PosePrior;
use cairn_vision::Frame;

/// Inlier matches needed where the IMU constrains the pose too.
const MIN_INLIERS_WITH_IMU: usize = 15;

/// Frame periods after the place was found again in which it is searched around more widely, and in which more is needed.
const RECOVERED: [usize; 2] = [2, 30];

/// Matches frames with the map.
#[derive(Debug)]
pub(crate) struct Locator {
    setup: Setup,
    local: LocalMap,
}

/// A first guess of the pose of a frame, and the matches around it.
#[derive(Clone)]
pub(crate) struct Seed {
    pub guess: Se3,
    pub matches: Matches,
    /// The key frame around which the map is searched where there are no matches.
    pub fallback: KeyFrameId,
    /// What is known of the pose without the matches.
    pub prior: Option<PosePrior>,
    /// Frame periods since the place was found again.
    pub since_recovery: usize,
}

/// A frame located in the local map.
pub(crate) struct Candidate {
    pub located: Located,
    pub matches: Matches,
    /// Landmarks that should be in view.
    pub expected: Vec<LandmarkId>,
    /// Matches before outliers were dropped.
    pub matched: usize,
    /// Inlier matches that are required.
    pub need: usize,
    /// The prior that is part of the pose.
    pub prior: Option<PosePrior>,
    /// The key frame around which the map was searched where there were no matches.
    pub fallback: KeyFrameId,
}

impl Locator {
    pub fn new(setup: Setup) -> Self {
        Self { setup, local: LocalMap::default() }
    }

    /// The pose that agrees with most of the matches; those that do not agree are dropped.
    pub fn locate(
        &self,
        snapshot: &Snapshot,
        frame: &Frame,
        guess: &Se3,
        prior: Option<&PosePrior>,
        matches: &mut Matches,
    ) -> Located {
        let camera = &self.setup.camera;
        let located = locate(snapshot, camera, frame, guess, &matches.landmarks, &matches.extra, prior);
        let located = gated(&self.setup, snapshot, frame, guess, prior, matches, located);
        matches.drop_outliers(&located.outliers);
        located
    }

    /// Matches with the previous frame around a guess, and farther out where the guess was poor.
    pub fn match_from(
        &self,
        last: &Last,
        guess: &Se3,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(Se3, Matches)> {
        let mut guess = *guess;
        let radius = if self.setup.camera.has_depth() { 7.0 } else { 15.0 };
        let known = last.landmarks.iter().flatten().count();
        let before = Before {
            frame: &last.frame,
            landmarks: &last.landmarks,
            world_from_camera: last.anchored.world_from_camera,
        };
        let few = self.setup.need(frame).min(15);
        let mut best: Option<(usize, Se3, Matches)> = None;
        // A good prediction finds most of what was seen; else search farther, then closely around the
        // resulting pose.
        for radius in [radius, 2.0 * radius, 4.0 * radius, radius] {
            let mut matches = match_last(snapshot, &self.setup.camera, &before, frame, &guess, radius);
            if matches.count() < few {
                continue;
            }
            let located = self.locate(snapshot, frame, &guess, None, &mut matches);
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
    pub fn by_reference(&self, last: &Last, frame: &Frame, snapshot: &Snapshot) -> Option<(Se3, Matches)> {
        let mut matches = match_key_frame(snapshot.key_frame(last.reference(snapshot)?)?, frame, 0.7);
        if matches.count() < 15 {
            return None;
        }
        let located = self.locate(snapshot, frame, &last.anchored.world_from_camera, None, &mut matches);
        (located.inliers >= 12).then_some((located.world_from_camera, matches))
    }

    /// Locates a frame in the local map around its matches, twice where the guess was poor.
    pub fn in_local_map(&mut self, frame: &Frame, snapshot: &Snapshot, seed: Seed) -> Candidate {
        let Seed { guess, mut matches, fallback, prior, since_recovery } = seed;
        let (camera, config) = (self.setup.camera, self.setup.config);
        matches.extra.clear();
        self.local.gather(snapshot, &matches, fallback, config.local_key_frames);
        let is_wide = since_recovery <= RECOVERED[0] || matches.count() == 0;
        let factor = if is_wide { 5.0 } else { 1.0 };
        let mut expected = self.local.search(snapshot, &camera, frame, &guess, factor, &mut matches);
        let mut matched = matches.count();
        let mut located = self.locate(snapshot, frame, &guess, prior.as_ref(), &mut matches);
        // Few of the expected landmarks were found: the guess was poor. Search again from the better pose.
        if located.inliers * 3 < expected.len() {
            let better = located.world_from_camera;
            expected = self.local.search(snapshot, &camera, frame, &better, 1.0, &mut matches);
            matched = matches.count();
            located = self.locate(snapshot, frame, &better, prior.as_ref(), &mut matches);
        }
        let need = match (&prior, since_recovery < RECOVERED[1]) {
            // The prior constrains the pose too: from the IMU, or that the camera turns on the spot.
            (Some(_), _) => self.setup.need(frame).min(MIN_INLIERS_WITH_IMU),
            (None, true) => self.setup.recovered_need(),
            (None, false) => self.setup.need(frame),
        };
        Candidate { located, matches, expected, matched, need, prior, fallback }
    }

    /// The pose of a frame taken next to one whose pose is known, with the landmarks that it shows.
    pub fn next_to(
        &mut self,
        before: &Last,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(AnchoredPose, Vec<Option<LandmarkId>>)> {
        let (guess, mut matches) =
            self.match_from(before, &before.anchored.world_from_camera, frame, snapshot)?;
        let (camera, config) = (self.setup.camera, self.setup.config);
        matches.extra.clear();
        self.local.gather(snapshot, &matches, before.anchored.reference, config.local_key_frames);
        self.local.search(snapshot, &camera, frame, &guess, 1.0, &mut matches);
        let located = self.locate(snapshot, frame, &guess, None, &mut matches);
        if located.inliers < config.min_inliers {
            return None;
        }
        let anchored = self.anchor_nearest(snapshot, before.anchored.reference, located.world_from_camera)?;
        Some((anchored, matches.landmarks))
    }

    /// A pose anchored to the nearest of the key frames that the local map was collected around.
    pub fn anchor_nearest(
        &self,
        snapshot: &Snapshot,
        fallback: KeyFrameId,
        world_from_camera: Se3,
    ) -> Option<AnchoredPose> {
        anchored_at(
            snapshot,
            self.local.nearest(snapshot, &world_from_camera.translation).unwrap_or(fallback),
            world_from_camera,
        )
    }

    /// The key frame that shares most landmarks with the frame that was located last.
    pub fn reference(&self) -> Option<KeyFrameId> {
        self.local.reference
    }
}
