//! Frames from before there is a map: a start with two views, and the poses of the waiting frames once it succeeds.

use super::Tracker;
use crate::state::{AnchoredPose, Evidence, Last, State, Tracked, anchored_at};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// Frames buffered while there is no map, so that they get their poses afterwards.
const WAITING: usize = 64;

impl Tracker {
    pub(super) fn start(&mut self, frame: Arc<Frame>) -> Tracked {
        self.odometry.miss();
        let features = frame.len();
        self.wait(&frame);
        let submitted = self.starter.step(&self.camera, &frame, self.features);
        let (state, request) = match submitted.map(|request| self.with_imu_segment(request)) {
            Ok(request) => (State::Starting { have: features, need: 0 }, Some(request)),
            Err(state) => (state, None),
        };
        self.since_key_frame = 0;
        let evidence = Evidence { features, ..Evidence::default() };
        Tracked {
            stamp: frame.stamp,
            state,
            pose: None,
            covariance: None,
            evidence,
            request,
            earlier: Vec::new(),
            scale_supported: true,
            seen: Vec::new(),
        }
    }

    /// Buffers a frame that may get its pose later.
    pub(crate) fn wait(&mut self, frame: &Arc<Frame>) {
        if self.waiting.len() == WAITING {
            self.waiting.pop_front();
        }
        self.waiting.push_back(frame.clone());
    }

    /// Poses of the frames from before the initialisation, newest to oldest, as far as they can be tracked.
    pub(super) fn track_waiting_frames(&mut self, snapshot: &Snapshot) -> Vec<(Stamp, AnchoredPose)> {
        let frames = std::mem::take(&mut self.waiting);
        let mut found = Vec::new();
        let (Some(last), false) = (&self.last, frames.is_empty()) else { return found };
        let mut before =
            Last { frame: last.frame.clone(), landmarks: last.landmarks.clone(), anchored: last.anchored };
        for frame in frames.iter().rev() {
            let known = snapshot.key_frames().find(|k| k.frame.is(frame));
            let (anchored, landmarks) = match known {
                Some(k) => (AnchoredPose::at(k.id, k.world_from_camera), k.landmarks.clone()),
                None => {
                    let Some((anchored, landmarks)) = self.track_next_to(&before, frame, snapshot) else {
                        break;
                    };
                    found.push((frame.stamp, anchored));
                    (anchored, landmarks)
                }
            };
            before = Last { frame: frame.clone(), landmarks, anchored };
        }
        found
    }

    /// The pose of a frame taken next to one whose pose is known.
    fn track_next_to(
        &mut self,
        before: &Last,
        frame: &Frame,
        snapshot: &Snapshot,
    ) -> Option<(AnchoredPose, Vec<Option<LandmarkId>>)> {
        let (guess, mut matches) =
            self.match_from(before, &before.anchored.world_from_camera, frame, snapshot)?;
        matches.extra.clear();
        self.local.gather(snapshot, &matches, before.anchored.reference, self.config.local_key_frames);
        self.local.search(snapshot, &self.camera, frame, &guess, 1.0, &mut matches);
        let located = self.locate(snapshot, frame, &guess, &mut matches);
        if located.inliers < self.config.min_inliers {
            return None;
        }
        let anchored = self.anchor_nearest(snapshot, before.anchored.reference, located.world_from_camera)?;
        Some((anchored, matches.landmarks))
    }

    /// A pose anchored to the nearest of the key frames that the local map was collected around.
    pub(super) fn anchor_nearest(
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
}
