//! Frames from before there is a map: a start with two views, and the poses of the waiting frames once it succeeds.

use super::Tracker;
use crate::first_clocks::Known;
use crate::shutter::Shutter;
use crate::start::Starter;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, Last, State, Tracked, anchored_at};
use cairn_atlas::{KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// How far the rotation between two views may be from what the gyroscope has measured where the lens is a guess: radians, and per
/// radian (`phone/b`: 0.016 of 0.24).
const OFF_RAD: [f64; 2] = [0.02, 0.15];
/// Frames buffered while there is no map, so that they get their poses afterwards.
const WAITING: usize = 64;

impl Tracker {
    pub(super) fn start(&mut self, frame: Arc<Frame>, snapshot: &Snapshot) -> Tracked {
        self.odometry.miss();
        let features = frame.len();
        self.wait(&frame);
        let submitted = match self.knows_clocks(&frame, snapshot) {
            true => {
                let newest = self.waiting.back().cloned().unwrap_or_else(|| frame.clone());
                self.starter.step(&self.camera, &newest, self.features)
            }
            false => Err(State::Starting { have: features, need: 0 }),
        };
        let submitted = submitted.and_then(|request| match self.contradicts_gyroscope(&request) {
            true => Err(State::Starting { have: features, need: 0 }),
            false => Ok(request),
        });
        let (state, request) = match submitted.map(|request| self.with_imu_segment(request)) {
            Ok(mut request) => {
                if let KeyFrameRequest::Pair { clocks, .. } = &mut request {
                    *clocks = self.flow;
                }
                (State::Starting { have: features, need: 0 }, Some(request))
            }
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

    /// Whether two views do not differ by the rotation that the gyroscope has measured between them, once its clock is known: what
    /// looks like parallax there is something else.
    fn contradicts_gyroscope(&self, request: &KeyFrameRequest) -> bool {
        let KeyFrameRequest::Pair { first, second, first_from_second, .. } = request else { return false };
        let known = self.inertial.as_ref().filter(|_| self.flow.is_some());
        let Some(turned) = known.and_then(|i| i.turned(first.stamp, second.stamp)) else { return false };
        let off = (turned.inverse() * first_from_second.rotation).angle();
        off > OFF_RAD[0] + OFF_RAD[1] * turned.angle()
    }

    /// Whether nothing more is waited for of clocks and rows before a map may begin. Once they are known, what was seen until then is
    /// corrected by them.
    fn knows_clocks(&mut self, frame: &Arc<Frame>, snapshot: &Snapshot) -> bool {
        let wanted = self.config.clocks_by_flow
            && self.shutter.is_estimated()
            && !self.camera.has_depth()
            && self.flow.is_none();
        let Some(inertial) = self.inertial.as_mut().filter(|_| wanted) else { return true };
        let camera_from_imu = inertial.imu_from_camera.rotation.inverse();
        let known =
            self.first_clocks.step(&self.camera, &self.shutter, frame, inertial.samples(), &camera_from_imu);
        match known {
            Known::Ended => return true,
            Known::NotYet => {}
            Known::Now(flow) => {
                inertial.shift_to(flow.offset_s[0]);
                self.flow = Some(flow);
                self.starter = Starter::default();
                for mut seen in std::mem::take(&mut self.waiting) {
                    Shutter::undo(Arc::make_mut(&mut seen), &self.camera);
                    let seen = self.at_middle_row(seen, snapshot);
                    self.waiting.push_back(seen);
                }
                // A map begins with a frame since which all readings are there.
                let from = self.inertial.as_ref().and_then(|i| i.samples().next().map(|s| s.stamp));
                let before = self.waiting.len().saturating_sub(1);
                for seen in self.waiting.iter().take(before).filter(|seen| Some(seen.stamp) >= from) {
                    self.starter.follow(seen, self.features);
                }
                return true;
            }
        }
        self.starter.follow(frame, self.features);
        false
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
