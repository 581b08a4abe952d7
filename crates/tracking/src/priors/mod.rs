//! Motion priors: what says where the camera is in a frame before its features are looked at, in the order in which they are asked.
//!
//! In: what each measures. Out: a first guess to match around, a prior of the pose that features give, a gate for it, and the pose
//! itself where too little is seen. A further sensor of motion is a file that implements [`MotionPrior`], and a line in
//! [`MotionPriors::in_order`].

mod depth;
mod inertial;
mod measured;
#[cfg(test)]
mod tests;
mod velocity;

use crate::dense::{DenseAligner, Placement, Prediction};
use crate::odometry::MotionSource;
use crate::reckoned::{Estimate, Reckoned};
use crate::shutter::Moving;
use crate::state::{AnchoredPose, KeyFrameRequest, Last, State, Tracked};
use crate::tracker::Candidate;
use cairn_adjust::{Located, MotionSince};
use cairn_atlas::{ImuSegment, KeyFrame, Snapshot};
use cairn_geometry::{Se3, So3};
use cairn_inertial::NavEstimate;
use cairn_sensor::{ImuSample, Stamp};
use cairn_solve::PosePrior;
pub(crate) use inertial::InertialPrior;
pub(crate) use measured::DeadReckoning;
pub use measured::MeasuredMotion;
use nalgebra::Matrix6;
pub(crate) use velocity::ConstantVelocity;

/// Something that tells of the camera's motion up to the frame that is tracked. `last` is the last frame that had a pose.
pub(crate) trait MotionPrior {
    /// The pose in the frame of this time: a first guess.
    fn predict(&self, last: Option<&Last>, stamp: Stamp) -> Option<Se3>;

    /// The pose where it is sure enough to go on with nothing else.
    fn carry(&self, _: Option<&Last>, _: Stamp) -> Option<Estimate> {
        None
    }

    /// The pose as a prior of that by features, where it is sure enough for that.
    fn prior(&self, _: Option<&Last>, _: Stamp) -> Option<PosePrior> {
        None
    }

    /// Whether a pose by features may be the one that is predicted; asked of the one that gave the prior.
    fn agrees(&self, _: Option<&Last>, _: Stamp, _world_from_camera: &Se3) -> bool {
        true
    }

    /// The camera's motion since the frame before, and how it was measured.
    fn relative(&self) -> Option<(Se3, MotionSource)> {
        None
    }

    /// Features have located the frame.
    fn correct(&mut self, _: &Correction) {}
}

/// A frame that features have located.
pub(crate) struct Correction<'a> {
    pub snapshot: &'a Snapshot,
    pub stamp: Stamp,
    pub anchored: &'a AnchoredPose,
    /// The last pose and the seconds since then, where that was a moment ago.
    pub before: Option<(Se3, f64)>,
    pub located: &'a Located,
    /// The prior that is part of the pose.
    pub prior: Option<&'a PosePrior>,
}

/// What the readings of the IMU predict for the frame that is tracked.
pub(crate) struct ByReadings {
    state: Option<NavEstimate>,
    turned: Option<So3>,
}

/// All motion priors of a tracker.
#[derive(Debug, Default)]
pub(crate) struct MotionPriors {
    pub inertial: Option<InertialPrior>,
    /// Aligns depth images where features do not suffice.
    pub depth: Option<DenseAligner>,
    /// Motion that is measured by other means than the camera and the IMU.
    pub measured: DeadReckoning,
    pub velocity: ConstantVelocity,
    /// The pose at which a key frame was asked for last.
    requested_at: Option<(Stamp, AnchoredPose)>,
}

impl MotionPriors {
    /// The priors in the order in which they are asked. An aligned depth image has corrected the state that the IMU predicts, and a
    /// measured motion is part of it.
    fn in_order(&self) -> impl Iterator<Item = &dyn MotionPrior> {
        let inertial = self.inertial.as_ref().map(|i| i as &dyn MotionPrior);
        let aligned = self.depth.as_ref().filter(|depth| depth.aligned().is_some());
        let measured = aligned.is_none().then_some(&self.measured as &dyn MotionPrior);
        let aligned = aligned.map(|depth| depth as &dyn MotionPrior);
        [inertial, aligned, measured, Some(&self.velocity as &dyn MotionPrior)].into_iter().flatten()
    }

    /// Takes what the sensors measured up to the frame that comes; `offset_s` is that of the IMU's clock.
    pub fn take(&mut self, imu: &[ImuSample], offset_s: f64) {
        self.measured.advance();
        if let Some(inertial) = &mut self.inertial {
            inertial.filter.take(imu, offset_s);
        }
    }

    /// Follows the changes of the map. `rescaled` is the factor by which its unit of length has changed.
    pub fn refresh(&mut self, snapshot: &Snapshot, rescaled: Option<f64>) {
        if let Some(factor) = rescaled {
            self.velocity.rescale(factor);
        }
        if let Some(inertial) = &mut self.inertial {
            inertial.filter.refresh(snapshot);
        }
    }

    /// Remembers what the IMU says of the motion since the frame of `from`, if that is the last one.
    pub fn measure(&mut self, from: Option<Stamp>, stamp: Stamp) {
        if let Some(inertial) = &mut self.inertial {
            inertial.measure(from, stamp);
        }
    }

    /// Predicts the pose in a frame.
    pub fn begin(&mut self, snapshot: &Snapshot, last: Option<&Last>, stamp: Stamp) {
        if let Some(inertial) = &mut self.inertial {
            inertial.begin(stamp);
            self.velocity.turned(last.and_then(|last| inertial.filter.turned(last.frame.stamp, stamp)));
        }
        if self.depth.as_ref().is_some_and(DenseAligner::is_active) {
            self.align(snapshot, stamp);
        }
    }

    /// Aligns the depth of a frame, once; the state that the IMU predicts is corrected by it.
    pub fn align(&mut self, snapshot: &Snapshot, stamp: Stamp) {
        let Some(depth) = self.depth.as_mut().filter(|depth| !depth.was_tried()) else { return };
        let predicted = self.inertial.as_ref().and_then(InertialPrior::predicted);
        let prediction = predicted
            .map(|p| Prediction { world_from_camera: p.world_from_camera, covariance: p.pose_covariance() });
        let Some(aligned) = depth.align(snapshot, stamp, prediction, self.measured.uncertain_step()) else {
            return;
        };
        if let Some(inertial) = &mut self.inertial {
            inertial.see(&aligned.reckoned);
        }
    }

    /// Features contradict the depth: the pose in the frame is predicted without it.
    pub fn refuse_depth(&mut self, stamp: Stamp) {
        if let Some(depth) = &mut self.depth {
            depth.refuse();
        }
        if let Some(inertial) = &mut self.inertial {
            inertial.begin(stamp);
        }
    }

    /// The pose was found without any of them: neither the readings nor the velocity lead there.
    pub fn disregard(&mut self) {
        self.velocity.forget();
        if let Some(inertial) = &mut self.inertial {
            inertial.disregard();
        }
    }

    /// The camera is not where it was believed to be, and nobody knows where it is.
    pub fn forget_place(&mut self) {
        if let Some(inertial) = &mut self.inertial {
            inertial.filter.forget();
        }
        if let Some(depth) = &mut self.depth {
            depth.moved_elsewhere();
        }
    }

    /// The first guess of the pose.
    pub fn predict(&self, last: Option<&Last>, stamp: Stamp) -> Option<Se3> {
        self.in_order().find_map(|prior| prior.predict(last, stamp))
    }

    /// Whether the readings of the IMU predict a pose, of a camera that was tracked a moment ago.
    pub fn is_predicted_by_readings(&self) -> bool {
        self.inertial.as_ref().is_some_and(InertialPrior::predicts_from_tracked)
    }

    /// Goes on without what the readings of the IMU predict for this frame; returns that. Nothing where they predict nothing, or have
    /// carried the pose themselves up to here.
    pub fn set_aside_readings(&mut self) -> Option<ByReadings> {
        let inertial = self.inertial.as_mut().filter(|i| i.filter.carried_since().is_none())?;
        let (state, turned) = (inertial.set_aside(), self.velocity.turned(None));
        (state.is_some() || turned.is_some()).then_some(ByReadings { state, turned })
    }

    /// Takes back what was set aside.
    pub fn put_back(&mut self, by_readings: ByReadings) {
        self.velocity.turned(by_readings.turned);
        if let Some(inertial) = &mut self.inertial {
            inertial.put_back(by_readings.state);
        }
    }

    /// Whether matches lead elsewhere than the readings of the IMU do.
    pub fn readings_contradict(&self, candidate: &Candidate) -> bool {
        let prior = self.inertial.as_ref().zip(candidate.prior.as_ref());
        prior.is_some_and(|(inertial, prior)| inertial.contradicts(&candidate.located, prior))
    }

    /// The readings of the IMU count for nothing in this frame.
    pub fn disregard_readings(&mut self) {
        if let Some(inertial) = &mut self.inertial {
            inertial.disregard();
        }
    }

    /// The first guess, where it is sure enough to go on with nothing else.
    pub fn sure(&self, last: Option<&Last>, stamp: Stamp) -> Option<Se3> {
        let first = self.in_order().find(|prior| prior.predict(last, stamp).is_some())?;
        Some(first.carry(last, stamp)?.world_from_camera)
    }

    /// The pose by the first that is sure enough to go on with nothing else.
    pub fn carry(&self, last: Option<&Last>, stamp: Stamp) -> Option<Estimate> {
        self.in_order().find_map(|prior| prior.carry(last, stamp))
    }

    /// The pose by the IMU, where it may carry the camera.
    pub fn carry_by_imu(&self, stamp: Stamp) -> Option<Estimate> {
        self.inertial.as_ref()?.carry(None, stamp)
    }

    /// What is known of the pose without features. Where the pose is that of the depth, they say what they see by themselves.
    pub fn prior(&self, last: Option<&Last>, stamp: Stamp) -> Option<PosePrior> {
        if self.is_front_end() {
            return self.inertial.as_ref()?.prior(last, stamp);
        }
        self.in_order().find_map(|prior| prior.prior(last, stamp))
    }

    /// Whether a pose by features may be the one that is known without them, and can be reached by the motion measured since the last
    /// key frame was asked for: from frame to frame tracking may creep along with what moves, by less than its noise.
    pub fn agrees(&self, snapshot: &Snapshot, last: Option<&Last>, stamp: Stamp, pose: &Se3) -> bool {
        let first = self.in_order().find(|prior| prior.prior(last, stamp).is_some());
        first.is_none_or(|prior| prior.agrees(last, stamp, pose)) && self.agrees_since_request(snapshot, pose)
    }

    fn agrees_since_request(&self, snapshot: &Snapshot, world_from_camera: &Se3) -> bool {
        let (Some((_, at)), Some(motion)) = (self.requested_at, self.measured.since_key_frame()) else {
            return true;
        };
        let before = snapshot.resolve(at.reference, &at.reference_from_camera);
        before.is_none_or(|before| motion.agrees(&(before.inverse() * *world_from_camera)))
    }

    /// The camera's motion since the frame before by another source than the map. The shape of a surface says more of a single step
    /// than the readings do.
    pub fn relative(&self) -> Option<(Se3, MotionSource)> {
        let depth = self.depth.as_ref().and_then(MotionPrior::relative);
        depth.or(self.inertial.as_ref().and_then(MotionPrior::relative)).or(self.measured.relative())
    }

    /// Features have located the frame.
    pub fn correct(&mut self, at: &Correction) {
        if let Some(inertial) = &mut self.inertial {
            inertial.correct(at);
        }
        self.measured.correct(at);
        self.velocity.correct(at);
    }

    /// The pose by the depth or by a measured motion, however sure.
    pub fn reckoned(&self, last: Option<&Last>) -> Option<Reckoned> {
        let aligned = self.depth.as_ref().and_then(DenseAligner::aligned);
        aligned.map(|aligned| aligned.reckoned).or(self.measured.since(last))
    }

    /// Whether the pose of each frame is that of its depth.
    pub fn is_front_end(&self) -> bool {
        self.depth.as_ref().is_some_and(DenseAligner::is_front_end)
    }

    /// Whether the depth of the frame was aligned.
    pub fn is_aligned(&self) -> bool {
        self.depth.as_ref().is_some_and(|depth| depth.aligned().is_some())
    }

    /// A pose and its covariance by features, along what a surface fixes replaced by those of the depth where each frame's pose is
    /// that of its depth.
    pub fn chosen(&mut self, by_features: &Located) -> (Se3, Option<Matrix6<f64>>) {
        let pose = by_features.world_from_camera;
        let by_them = by_features.information.try_inverse();
        // What features say nothing of may be a metre or a radian off.
        let covariance = by_them.unwrap_or_else(Matrix6::identity);
        let pose = self.depth.as_mut().map_or(pose, |depth| depth.chosen(pose, &covariance));
        let depth = self.depth.as_ref().filter(|depth| depth.is_front_end());
        let covariance = match depth.and_then(DenseAligner::aligned) {
            Some(aligned) => Some(aligned.reckoned.covariance),
            None => by_them,
        };
        (pose, covariance)
    }

    /// The motion of a camera whose rows are exposed one after the other, and its pose, as far as the IMU predicts them; from the
    /// last frames only where that is a moment ago (`is_recent`).
    pub fn moving(&self, stamp: Stamp, is_recent: bool) -> (Option<Se3>, Moving) {
        let filter = self.inertial.as_ref().map(|inertial| &inertial.filter);
        let predicted = filter.filter(|_| is_recent).and_then(|filter| filter.predict(stamp));
        let last = self.velocity.known().filter(|_| is_recent);
        let turning = (filter.and_then(|filter| filter.turning(stamp)))
            .or(last.map(|v| v.fixed_rows::<3>(3).into_owned()));
        let velocity = (predicted.as_ref().map(|p| p.world_from_camera.rotation.inverse() * p.velocity))
            .or(last.map(|v| v.fixed_rows::<3>(0).into_owned()));
        let moving = Moving { turning: turning.unwrap_or_default(), velocity: velocity.unwrap_or_default() };
        (predicted.map(|p| p.world_from_camera), moving)
    }

    /// The IMU data of a key frame that features have located.
    pub fn take_segment(&mut self, stamp: Stamp) -> Option<ImuSegment> {
        self.inertial.as_mut().map(|inertial| inertial.filter.take_segment(stamp))
    }

    /// A request that begins a map, with the IMU data added.
    pub fn with_imu_data(&self, request: KeyFrameRequest) -> KeyFrameRequest {
        match &self.inertial {
            Some(inertial) => inertial.added_to(request),
            None => request,
        }
    }

    /// A map begins with this key frame.
    pub fn map_created(&mut self, snapshot: &Snapshot, k: &KeyFrame, anchored: AnchoredPose) {
        self.velocity.forget();
        self.measured.restart(true);
        if let Some(inertial) = &mut self.inertial {
            inertial.filter.map_created(k);
        }
        if let Some(depth) = &mut self.depth {
            depth.moved_elsewhere();
            depth.placed(snapshot, k.stamp, anchored, Placement::Sure);
        }
    }

    /// Remembers the depth of a frame with its pose. `is_elsewhere`: the place was found again with this frame; `enough`: inlier
    /// matches that locate a frame by themselves.
    pub fn remember_depth(
        &mut self,
        snapshot: &Snapshot,
        tracked: &Tracked,
        is_elsewhere: bool,
        enough: usize,
    ) {
        let Some(depth) = &mut self.depth else { return };
        if is_elsewhere {
            depth.moved_elsewhere();
        }
        let Some(anchored) = tracked.pose else { return };
        let by = match tracked.state {
            State::Tracking if tracked.evidence.inliers >= enough => Placement::Sure,
            State::Tracking => Placement::Weak,
            _ => Placement::Carried,
        };
        depth.placed(snapshot, tracked.stamp, anchored, by);
    }

    /// Gives a key frame that is asked for the motion measured since the one before it, which counts from there on; `by_gyroscope`:
    /// where nothing else measures it, how far the camera has turned.
    pub fn restart_at_request(&mut self, snapshot: &Snapshot, tracked: &mut Tracked, by_gyroscope: bool) {
        let carried = self.carried_by_depth(snapshot, tracked);
        let Some(request) = &mut tracked.request else { return };
        let stamp = request.stamp();
        let since = self.measured.restart_at_key_frame(stamp);
        let before = self.requested_at.filter(|_| by_gyroscope);
        let turned = before.and_then(|(before, _)| self.inertial.as_ref()?.turned_since(before, stamp));
        if let KeyFrameRequest::Next { anchored, motion, .. } = request {
            *motion = since.or(carried).or(turned);
            self.requested_at = Some((stamp, *anchored));
        } else {
            self.requested_at = None;
        }
    }

    /// The motion since the key frame that was asked for last, where depth alone has carried the pose from there on: no landmark will
    /// relate the two.
    fn carried_by_depth(&self, snapshot: &Snapshot, tracked: &Tracked) -> Option<MotionSince> {
        let is_carried = matches!(tracked.state, State::Coasting { .. });
        let aligned = self.depth.as_ref()?.aligned().filter(|_| is_carried)?;
        let (stamp, at) = self.requested_at?;
        let before = snapshot.resolve(at.reference, &at.reference_from_camera)?;
        let since_from_now = before.inverse() * tracked.pose?.world_from_camera;
        let variance = aligned.reckoned.sigma().map(|s| s * s);
        Some(MotionSince { stamp, since_from_now, variance })
    }
}
