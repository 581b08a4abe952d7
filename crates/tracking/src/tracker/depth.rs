//! Where features do not suffice, the depth image gives the pose ([`crate::dense`]): when it is aligned, and what it is told.

use super::Tracker;
use crate::dense::{DenseAligner, Placement, Prediction};
use crate::match_last::Matches;
use crate::odometry::MotionSource;
use crate::reckoning::Reckoned;
use crate::state::{AnchoredPose, State, Tracked};
use cairn_adjust::MotionSince;
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_inertial::NavEstimate;
use cairn_sensor::{DepthImage, DepthSensor, GrayImage, Stamp};
use cairn_vision::Frame;
use std::sync::Arc;

impl Tracker {
    /// Adds the depth sensor, mounted at `camera_from_depth`: where features do not suffice, its images carry the pose.
    pub fn with_depth(self, sensor: &DepthSensor, camera_from_depth: Se3) -> Self {
        let dense = DenseAligner::new(sensor, camera_from_depth, self.config.coast_sigma, self.config.dense);
        Self { dense, ..self }
    }

    /// The depth image of the frame that is tracked next, and the gray image where it shows the same pixels; to be told before each
    /// [`Tracker::step`].
    pub fn depth_seen(&mut self, image: Option<Arc<DepthImage>>, gray: Option<Arc<GrayImage>>) {
        if let Some(dense) = &mut self.dense {
            dense.next(image, gray);
        }
    }

    /// Aligns the depth of a frame, once; the state that the IMU predicts is corrected by it.
    pub(super) fn align(
        &mut self,
        frame: &Frame,
        snapshot: &Snapshot,
        predicted: Option<NavEstimate>,
    ) -> Option<NavEstimate> {
        let Some(dense) = self.dense.as_mut().filter(|dense| !dense.was_tried()) else { return predicted };
        let prediction = predicted
            .as_ref()
            .map(|p| Prediction { world_from_camera: p.world_from_camera, covariance: p.pose_covariance() });
        let step = self.reckoning.uncertain_step();
        let Some(aligned) = dense.align(snapshot, frame.stamp, prediction, step) else { return predicted };
        let Reckoned { world_from_camera, covariance, .. } = aligned.reckoned;
        let predicted = predicted?;
        predicted.seen(&world_from_camera, &covariance).or(Some(predicted))
    }

    /// Whether features that suffice by themselves contradict the depth, where that only helps them out.
    pub(crate) fn contradicts_depth(&self, pose: &Se3, matches: &Matches) -> bool {
        let helping = self.dense.as_ref().filter(|dense| !dense.is_front_end());
        let aligned = helping.and_then(|dense| dense.aligned());
        aligned.is_some_and(|a| !a.reckoned.agrees(pose)) && matches.count() >= self.config.min_inliers
    }

    /// What predicts the pose of a frame once its depth counts for nothing.
    pub(super) fn without_depth(&mut self, frame: &Frame) -> (Option<NavEstimate>, Option<Reckoned>) {
        if let Some(dense) = &mut self.dense {
            dense.refuse();
        }
        let predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        let reckoned = self.reckoned().filter(|_| predicted.is_none());
        (predicted, reckoned)
    }

    /// The camera's motion since the frame before, by depth.
    pub(super) fn aligned_motion(&self) -> Option<(Se3, MotionSource)> {
        let aligned = self.dense.as_ref()?.aligned()?;
        Some((aligned.last_from_now, MotionSource::Measured))
    }

    /// The motion since the key frame that was asked for last, where depth alone has carried the pose from there on: no landmark will
    /// relate the two.
    pub(super) fn carried_by_depth(&self, snapshot: &Snapshot, tracked: &Tracked) -> Option<MotionSince> {
        let aligned =
            self.dense.as_ref()?.aligned().filter(|_| matches!(tracked.state, State::Coasting { .. }))?;
        let (stamp, at) = self.requested_at?;
        let before = snapshot.resolve(at.reference, &at.reference_from_camera)?;
        let since_from_now = before.inverse() * tracked.pose?.world_from_camera;
        let variance = aligned.reckoned.sigma().map(|s| s * s);
        Some(MotionSince { stamp, since_from_now, variance })
    }

    /// Remembers the depth of a frame with its pose.
    pub(super) fn remember_depth(&mut self, snapshot: &Snapshot, tracked: &Tracked) {
        let Some(dense) = &mut self.dense else { return };
        if self.since_recovery == 0 {
            dense.moved_elsewhere();
        }
        let Some(anchored) = tracked.pose else { return };
        let by = match tracked.state {
            State::Tracking if tracked.evidence.inliers >= self.config.min_inliers => Placement::Sure,
            State::Tracking => Placement::Weak,
            _ => Placement::Carried,
        };
        dense.placed(snapshot, tracked.stamp, anchored, by);
    }

    /// A map begins with the present frame.
    pub(super) fn dense_map_created(&mut self, snapshot: &Snapshot, stamp: Stamp, anchored: AnchoredPose) {
        if let Some(dense) = &mut self.dense {
            dense.moved_elsewhere();
            dense.placed(snapshot, stamp, anchored, Placement::Sure);
        }
    }
}
