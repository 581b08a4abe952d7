//! A place that was found by the shape of its surfaces while tracking was lost: tracking goes on there, by depth and by
//! what features there are.
//!
//! In: the last depth images with their poses relative to a key frame, as the search has followed them. Out: the aligner's
//! surface and last pose, as if tracking had never been lost. Where the next frame cannot be carried from there, tracking is as
//! lost as before, and nothing of it is kept.

use super::{Now, Tracker};
use crate::dense::PREDICTED_S;
use crate::state::{AnchoredPose, Last, State, Tracked, anchored_at, map_of};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, Stamp};
use cairn_vision::Frame;
use nalgebra::Matrix6;
use std::sync::Arc;

/// A depth image, and the pose of the camera (not of the depth sensor) in the camera frame of a key frame.
#[derive(Clone, Debug)]
pub struct DepthPlaced {
    /// When it was taken.
    pub stamp: Stamp,
    /// The image.
    pub image: Arc<DepthImage>,
    /// The pose.
    pub key_frame_from_camera: Se3,
}

/// Where a lost camera is, found by the shape of the surfaces.
#[derive(Clone, Debug)]
pub struct FoundByDepth {
    /// The key frame that the poses are relative to.
    pub key_frame: KeyFrameId,
    /// The images that were followed there, oldest first.
    pub frames: Vec<DepthPlaced>,
    /// Of the last pose's right perturbation (translation, rotation).
    pub covariance: Matrix6<f64>,
}

/// What is put back where tracking does not go on.
pub(super) struct Before {
    last: Option<Last>,
    located: Option<Stamp>,
    /// Nothing bounds where the camera may be: features have to agree.
    needs_features: bool,
}

/// Features of an image, as a share of the budget, from which on they may speak for a place.
const ENOUGH_FEATURES: f64 = 0.25;
/// The error of both poses, and the distance within which rooms are taken not to repeat.
const SLACK_M: f64 = 1.0;
const MOST_REACH_M: f64 = 5.0;

impl Tracker {
    /// Whether a place found by depth could be believed for a camera that is lost in this frame: it was tracked just before, there are
    /// features that may agree, or shape is to be enough.
    pub fn may_believe_depth(&self, frame: &Frame) -> bool {
        let enough = frame.len() as f64 >= ENOUGH_FEATURES * self.setup.features as f64;
        let is_bounded = self.last.as_ref().is_some_and(|last| self.shape_reach(last, frame.stamp).is_some());
        self.setup.config.find_by_shape_alone || is_bounded || enough
    }

    /// How far from its last pose the camera may be found by shape alone, in metres; `None` where it may have got into another
    /// room meanwhile, which may look like the one it was in.
    fn shape_reach(&self, last: &Last, stamp: Stamp) -> Option<f64> {
        let reach = self.setup.config.motion.fastest_m_s * (stamp - last.frame.stamp) + SLACK_M;
        (0.0..=MOST_REACH_M).contains(&reach).then_some(reach)
    }

    /// Sets tracking to where the search has found the camera, for a lost one; `None` where that is of no use: too old, or a
    /// place that the camera cannot have reached.
    pub(super) fn begin_where_found(&mut self, now: &Now) -> Option<Before> {
        let Now { frame, snapshot, .. } = *now;
        let found = self.found.take().filter(|_| self.mode.is_lost())?;
        let newest = found.frames.last()?;
        let since_s = frame.stamp - newest.stamp;
        let place = snapshot.resolve(found.key_frame, &newest.key_frame_from_camera)?;
        let reference = nearest_key_frame(snapshot, found.key_frame, &place)?;
        let is_new = since_s > 0.0 && since_s < PREDICTED_S;
        if !is_new || !self.unit.reaches(snapshot, self.last.as_ref(), reference, &place, newest.stamp) {
            return None;
        }
        let placed = |f: &DepthPlaced| -> Option<(Stamp, Arc<DepthImage>, AnchoredPose)> {
            let pose = snapshot.resolve(found.key_frame, &f.key_frame_from_camera)?;
            Some((f.stamp, f.image.clone(), anchored_at(snapshot, reference, pose)?))
        };
        let frames: Vec<_> = found.frames.iter().filter_map(placed).collect();
        let (stamp, _, anchored) = frames.last()?.clone();
        self.priors.depth.as_mut()?.begin_at(&frames, found.covariance);
        if let Some(inertial) = &mut self.priors.inertial {
            let information = found.covariance.try_inverse().unwrap_or_default();
            inertial.filter.update(snapshot, stamp, &anchored, None, &information);
        }
        let last = self.last.replace(Last::without_landmarks(frame.clone(), anchored));
        let located = self.clock.located.replace(stamp);
        let is_bounded = last.as_ref().is_some_and(|last| {
            let moved =
                (anchored.world_from_camera.translation - last.anchored.world_from_camera.translation).norm();
            self.shape_reach(last, stamp).is_some_and(|reach| moved <= reach)
                && map_of(snapshot, last.anchored.reference) == map_of(snapshot, reference)
        });
        let needs_features = !is_bounded && !self.setup.config.find_by_shape_alone;
        let before = Before { last, located, needs_features };
        self.clock.since_recovery = 1;
        self.mode.replace();
        self.priors.velocity.forget();
        self.priors.measured.restart(false);
        Some(before)
    }

    /// Whether the frame goes on from where it was found; else tracking is lost as before.
    pub(super) fn keep_or_put_back(&mut self, before: Before, now: &Now, tracked: &mut Tracked) {
        let goes_on = tracked.pose.is_some() && !matches!(tracked.state, State::Lost { .. });
        if !goes_on || (before.needs_features && tracked.state != State::Tracking) {
            *tracked = self.lose(now, tracked.evidence.inliers);
            (self.last, self.clock.located) = (before.last, before.located);
            self.priors.forget_place();
        }
    }
}

/// The key frame of the same map that looks most like a pose: nearest, a radian counting as a metre.
fn nearest_key_frame(snapshot: &Snapshot, of: KeyFrameId, pose: &Se3) -> Option<KeyFrameId> {
    let map = map_of(snapshot, of)?;
    let away = |at: &Se3| {
        let off = at.inverse() * *pose;
        off.translation.norm() + off.rotation.angle()
    };
    let all = snapshot.key_frames().filter(|k| k.map == map);
    all.map(|k| (away(&k.world_from_camera), k.id))
        .min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))
        .map(|(_, id)| id)
}
