//! Too few matches: the IMU or another measured motion carries the pose for a while (coasting), a short blank view (a plain wall) is bridged by
//! the motion model, and after that a new map begins at the last known pose, with a relocation prior.

use super::Tracker;
use crate::imu::InertialFilter;
use crate::on_the_spot::PureRotation;
use crate::scale::PACE_SIGMA;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, RelocationPrior, State, Tracked};
use crate::state::{Last, anchored_at};
use cairn_atlas::{ImuSegment, KeyFrameId, Snapshot};
use cairn_geometry::Se3;
use cairn_inertial::NavEstimate;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// Assumed greatest motion of a walking person while not tracked: metres per second and radians per second.
const UNTRACKED_SPEED_M_S: f64 = 1.5;
const UNTRACKED_TURN_RAD_S: f64 = 1.5;
/// How far apart two observations of one place may be in a map that has drifted, metres.
const DRIFT_M: f64 = 2.0;
/// Longest blank view, in seconds, across which the motion model may place what is seen next.
const BLANK_S: f64 = 1.0;
/// Seconds between key frames while coasting.
const COAST_KEY_FRAME_S: f64 = 0.25;

/// Standard deviation of the logarithm of a new map's scale where not even a walking speed is known.
const NO_PACE_SIGMA: f64 = 2.0;

impl Tracker {
    /// Whether the pose predicted by the IMU is still accurate enough to coast with.
    pub(crate) fn may_coast(&self, frame: &Frame, predicted: &NavEstimate) -> bool {
        predicted.world_from_camera.is_finite()
            && predicted.position_sigma() <= self.config.coast_sigma
            && self.inertial.as_ref().is_some_and(|i| i.carried_s(frame.stamp) <= self.config.coast_s)
    }

    /// Handles a frame with too few matches: coasts on the IMU while that is accurate enough, else tracking
    /// is lost.
    pub(crate) fn miss(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
        inliers: usize,
        predicted: Option<NavEstimate>,
        idle: bool,
    ) -> Tracked {
        let predicted = self.align(&frame, snapshot, predicted);
        let is_aligned = self.dense.as_ref().is_some_and(|dense| dense.aligned().is_some());
        let good = predicted.filter(|predicted| self.may_coast(&frame, predicted));
        let (good, spot) = self.held_on_the_spot(&frame, good);
        let is_on_the_spot = spot != PureRotation::No;
        let reckoned = self.reckoned().filter(|r| good.is_none() && r.may_coast());
        let carried = (good.as_ref().map(|b| (b.world_from_camera, b.position_sigma(), b.pose_covariance())))
            .or(reckoned.map(|r| (r.world_from_camera, r.sigma()[0], r.covariance)));
        let Some((anchored, sigma, covariance)) = carried.and_then(|(pose, sigma, covariance)| {
            Some((self.predicted_pose(snapshot, &pose)?, sigma, covariance))
        }) else {
            let turned = self.track_rotation(&frame, snapshot);
            return turned.unwrap_or_else(|| self.lose(frame, inliers));
        };
        self.lost = false;
        self.lost_frames += 1;
        self.velocity = None;
        let since_s = self.located.map_or(0.0, |t| frame.stamp - t);
        let mut due = reckoned.is_some() && self.since_key_frame as f64 >= COAST_KEY_FRAME_S * self.rate_hz;
        if let Some((inertial, predicted)) = self.inertial.as_mut().zip(good) {
            inertial.coast(frame.stamp, &anchored, predicted, is_aligned || is_on_the_spot);
            due = inertial.seconds_since_request(frame.stamp).is_none_or(|s| s >= COAST_KEY_FRAME_S);
        }
        let depth = self.camera.has_depth();
        let have = (0..frame.len()).filter(|i| !depth || frame.has_depth(*i)).count();
        let request = (due && idle && have >= (self.features / 12).max(40)).then(|| {
            let landmarks = vec![None; frame.len()];
            self.last = Some(Last { frame: frame.clone(), landmarks: landmarks.clone(), anchored });
            self.reckoning.restart(false);
            self.since_key_frame = 0;
            let still_sigma = self.inertial.as_ref().and_then(|i| i.still_sigma(frame.stamp, spot));
            let segment = self.inertial.as_mut().map(|i| i.take_segment(frame.stamp));
            let imu = segment.map(|segment| ImuSegment { still_sigma, ..segment });
            // Views that differ by a rotation alone tell no depth.
            let (orientation_only, rescale) = (is_on_the_spot, None);
            KeyFrameRequest::Next {
                frame: frame.clone(),
                landmarks,
                anchored,
                imu,
                orientation_only,
                rescale,
                motion: None,
            }
        });
        Tracked {
            stamp: frame.stamp,
            state: State::Coasting { since_s, sigma },
            pose: Some(anchored),
            covariance: Some(covariance),
            evidence: Evidence { features: frame.len(), inliers, ..Evidence::default() },
            request,
            earlier: Vec::new(),
            scale_supported: true,
            seen: Vec::new(),
        }
    }

    /// What the readings predict, corrected where the images say that the camera turns on the spot; and whether they do.
    fn held_on_the_spot(
        &mut self,
        frame: &Arc<Frame>,
        predicted: Option<NavEstimate>,
    ) -> (Option<NavEstimate>, PureRotation) {
        let Some(predicted) = predicted else { return (None, PureRotation::No) };
        if self.camera.has_depth() {
            return (Some(predicted), PureRotation::No);
        }
        let spot = self.spot.step(&self.camera, frame, &predicted.world_from_camera.rotation);
        let held = (spot == PureRotation::New).then(|| InertialFilter::on_the_spot(&predicted)).flatten();
        (Some(held.unwrap_or(predicted)), spot)
    }

    fn predicted_pose(&self, snapshot: &Snapshot, world_from_camera: &Se3) -> Option<AnchoredPose> {
        let (reference, _) = snapshot.surviving_ancestor(self.last.as_ref()?.anchored.reference)?;
        anchored_at(snapshot, reference, *world_from_camera)
    }

    /// A request that begins a map, with the IMU data added.
    pub(crate) fn with_imu_segment(&self, mut request: KeyFrameRequest) -> KeyFrameRequest {
        let Some(inertial) = &self.inertial else { return request };
        match &mut request {
            KeyFrameRequest::First { frame, imu, .. } => {
                *imu = Some(inertial.segment_since(None, frame.stamp))
            }
            KeyFrameRequest::Pair { first, second, imu, .. } => {
                *imu = Some(inertial.segment_since(Some(first.stamp), second.stamp));
            }
            KeyFrameRequest::Next { .. } => {}
        }
        request
    }

    /// Begins a new map when tracking has been lost for a while. Nothing is discarded: the previous map stays and can
    /// be recognised later. The new map begins at the last known pose, with an uncertainty that grows with the time
    /// since.
    pub(crate) fn begin_new_map(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
    ) -> Option<KeyFrameRequest> {
        self.wait(&frame);
        let since = self.located.max(self.map_created)?;
        if frame.stamp - since < self.config.new_map_s {
            return None;
        }
        let request = self.starter.step(&self.camera, &frame, self.features).ok()?;
        let mut request = self.with_imu_segment(request);
        match &mut request {
            KeyFrameRequest::First { frame, relocation_prior, .. } => {
                *relocation_prior = self.relocation_prior(frame, snapshot);
            }
            KeyFrameRequest::Pair { first, second, relocation_prior, .. } => {
                let speed = self.assumed_speed(first.stamp, second.stamp);
                *relocation_prior =
                    self.relocation_prior(first, snapshot).map(|prior| RelocationPrior { speed, ..prior });
            }
            KeyFrameRequest::Next { .. } => {}
        }
        Some(request)
    }

    fn relocation_prior(&self, frame: &Frame, snapshot: &Snapshot) -> Option<RelocationPrior> {
        if let Some(prior) = self.rotation_prior(frame.stamp, snapshot) {
            return Some(prior);
        }
        let last = self.last.as_ref()?;
        let predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        if let Some(predicted) = predicted.filter(|f| f.world_from_camera.is_finite()) {
            let anchored = anchored_at(
                snapshot,
                snapshot.surviving_ancestor(last.anchored.reference)?.0,
                predicted.world_from_camera,
            )?;
            let (sigma, sigma_rad) = (predicted.position_sigma(), predicted.rotation_sigma());
            return Some(RelocationPrior {
                anchored,
                sigma,
                sigma_rad,
                speed: None,
                sigma_log_scale: self.sigma_log_scale(),
                gravity_aligned: true,
                assumed_since: None,
            });
        }
        if let Some(reckoned) = self.reckoned() {
            let [sigma, sigma_rad] = reckoned.sigma();
            let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
            return Some(RelocationPrior {
                anchored: anchored_at(snapshot, reference, reckoned.world_from_camera)?,
                sigma,
                sigma_rad,
                speed: None,
                sigma_log_scale: self.sigma_log_scale(),
                gravity_aligned: false,
                assumed_since: None,
            });
        }
        let untracked_s = frame.stamp - last.frame.stamp;
        // Where the view ran out of features, the motion is assumed to continue for a while; a sudden loss does not
        // justify that assumption.
        let extrapolated_s = if self.view_was_blank(last) { untracked_s.clamp(0.0, BLANK_S) } else { 0.0 };
        let moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * extrapolated_s)));
        let predicted = last.anchored.world_from_camera * moved;
        let anchored =
            anchored_at(snapshot, snapshot.surviving_ancestor(last.anchored.reference)?.0, predicted)?;
        let (sigma, sigma_rad) =
            (self.max_plausible_speed() * untracked_s, UNTRACKED_TURN_RAD_S * untracked_s);
        Some(RelocationPrior {
            anchored,
            sigma,
            sigma_rad,
            speed: None,
            sigma_log_scale: self.sigma_log_scale(),
            gravity_aligned: false,
            assumed_since: self.scale_support.assumed_since(),
        })
    }

    /// About one metre in the map's unit: without metric scale it is estimated from the speed so far.
    pub(crate) fn metre_in_map_units(&self) -> f64 {
        if self.camera.has_depth() { 1.0 } else { self.typical_speed().unwrap_or(1.0) / UNTRACKED_SPEED_M_S }
    }

    /// The greatest plausible speed without tracking, in the map's unit per second: that of a walking person,
    /// or the speed so far if that was greater.
    fn max_plausible_speed(&self) -> f64 {
        (UNTRACKED_SPEED_M_S * self.metre_in_map_units()).max(self.typical_speed().unwrap_or(0.0))
    }

    /// Whether the camera can have reached a pose in a key frame's map since its last known pose: this rejects rooms
    /// that only look the same. For another map, or a loaded one, appearance alone decides.
    pub(crate) fn reaches(
        &self,
        snapshot: &Snapshot,
        key_frame: KeyFrameId,
        place: &Se3,
        stamp: Stamp,
    ) -> bool {
        let Some(last) = &self.last else { return true };
        let map = |id| snapshot.surviving_ancestor(id).and_then(|(id, _)| Some(snapshot.key_frame(id)?.map));
        if map(key_frame) != map(last.anchored.reference) {
            return true;
        }
        let moved = (place.translation - last.anchored.world_from_camera.translation).norm();
        moved
            <= 2.0 * self.max_plausible_speed() * (stamp - last.frame.stamp)
                + DRIFT_M * self.metre_in_map_units()
    }

    /// Uncertainty of the scale of a map that begins now against the previous one: the standard deviation of its
    /// logarithm.
    pub(crate) fn sigma_log_scale(&self) -> f64 {
        match (self.camera.has_depth(), self.typical_speed()) {
            (true, _) => 0.0,
            (false, Some(_)) => PACE_SIGMA[0],
            (false, None) => NO_PACE_SIGMA,
        }
    }

    /// Bridges a blank view: once features with depth are seen again, they enter the map at the pose that the motion
    /// model predicts across the gap. The frame itself counts as lost; the next ones are tracked from it. Only where
    /// the view had run out of features: after a sudden motion, constant velocity is not a sound assumption.
    pub(crate) fn bridge(&mut self, frame: Arc<Frame>, snapshot: &Snapshot) -> Option<KeyFrameRequest> {
        let last = self.last.as_ref()?;
        let blank = self.camera.has_depth() && self.view_was_blank(last);
        let deep = (0..frame.len()).filter(|i| frame.has_depth(*i)).count();
        if !blank || !self.recent(&frame, BLANK_S) || deep < (self.features / 12).max(40) {
            return None;
        }
        let moved = Se3::exp(&(self.velocity? * (frame.stamp - last.frame.stamp)));
        let world_from_camera = last.anchored.world_from_camera * moved;
        let (reference, _) = snapshot.surviving_ancestor(last.anchored.reference)?;
        let anchored = anchored_at(snapshot, reference, world_from_camera)?;
        let landmarks = vec![None; frame.len()];
        self.last = Some(Last { frame: frame.clone(), landmarks: landmarks.clone(), anchored });
        self.reckoning.restart(false);
        self.since_key_frame = 0;
        let imu = self.inertial.as_mut().map(|i| i.take_segment(frame.stamp));
        Some(KeyFrameRequest::Next {
            frame,
            landmarks,
            anchored,
            imu,
            orientation_only: false,
            rescale: None,
            motion: None,
        })
    }

    /// Whether the last view had run out of features, as in front of a blank wall.
    fn view_was_blank(&self, last: &Last) -> bool {
        4 * last.frame.len() < self.features
    }

    pub(crate) fn lose(&mut self, frame: Arc<Frame>, inliers: usize) -> Tracked {
        self.lost = true;
        self.lost_frames += 1;
        let evidence = Evidence { features: frame.len(), inliers, ..Evidence::default() };
        let state = State::Lost { inliers, need: self.config.min_inliers };
        Tracked {
            stamp: frame.stamp,
            state,
            pose: None,
            covariance: None,
            evidence,
            request: None,
            earlier: Vec::new(),
            scale_supported: self.is_scale_supported(),
            seen: Vec::new(),
        }
    }
}
