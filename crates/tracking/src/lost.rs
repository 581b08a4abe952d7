//! When too little is seen: the inertial sensor carries the pose for a while, a blank wall is passed by going on as
//! before, and after that a new world begins where the eye was last known to be.

use crate::scale::PACE_SIGMA;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, RelocationPrior, State, Tracked};
use crate::tracker::{Last, Tracker, anchored_at};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::Se3;
use cairn_inertial::NavEstimate;
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use std::sync::Arc;

/// How fast someone on foot may move while nothing is seen: metres a second and radians a second.
const UNSEEN_SPEED: f64 = 1.5;
const UNSEEN_TURN: f64 = 1.5;
/// How far apart two sights of one place may stand in a world that has drifted, metres.
const DRIFTED: f64 = 2.0;
/// Seconds of a blank view after which the motion before may place what is seen next.
const BLANK_S: f64 = 1.0;
/// Seconds between key frames while the inertial sensor carries the pose.
const COAST_KEY_FRAME_S: f64 = 0.25;

/// Standard deviation of the logarithm of a new map's scale where not even a pace is known.
const NO_PACE_SIGMA: f64 = 1.0;

impl Tracker {
    /// Whether the pose that is felt still is good enough to go by.
    pub(crate) fn may_coast(&self, frame: &Frame, predicted: &NavEstimate) -> bool {
        predicted.world_from_camera.is_finite()
            && predicted.place_sigma() <= self.config.coast_sigma
            && self.inertial.as_ref().is_some_and(|i| i.carried_s(frame.stamp) <= self.config.coast_s)
    }

    /// Too little was seen: the pose is what is felt while that is good enough, else tracking is lost.
    pub(crate) fn miss(
        &mut self,
        frame: Arc<Frame>,
        snapshot: &Snapshot,
        inliers: usize,
        predicted: Option<NavEstimate>,
        idle: bool,
    ) -> Tracked {
        let good = predicted.filter(|predicted| self.may_coast(&frame, predicted));
        let Some((predicted, anchored)) =
            good.and_then(|predicted| Some((predicted.clone(), self.predicted_pose(snapshot, &predicted)?)))
        else {
            return self.lose(frame, inliers);
        };
        self.lost = false;
        self.lost_frames += 1;
        self.velocity = None;
        let since_s = self.located.map_or(0.0, |t| frame.stamp - t);
        let sigma = predicted.place_sigma();
        let mut due = false;
        if let Some(inertial) = &mut self.inertial {
            inertial.coast(frame.stamp, &anchored, predicted);
            due = inertial.unoffered(frame.stamp).is_none_or(|s| s >= COAST_KEY_FRAME_S);
        }
        let depth = self.camera.has_depth();
        let have = (0..frame.len()).filter(|i| !depth || frame.has_depth(*i)).count();
        let request = (due && idle && have >= (self.features / 12).max(40)).then(|| {
            let landmarks = vec![None; frame.len()];
            self.last = Some(Last { frame: frame.clone(), landmarks: landmarks.clone(), anchored });
            self.since_key_frame = 0;
            let imu = self.inertial.as_mut().map(|i| i.sense(frame.stamp));
            KeyFrameRequest::Next {
                frame: frame.clone(),
                landmarks,
                anchored,
                imu,
                orientation_only: false,
                rescale: None,
            }
        });
        Tracked {
            stamp: frame.stamp,
            state: State::Coasting { since_s, sigma },
            pose: Some(anchored),
            evidence: Evidence { features: frame.len(), inliers, ..Evidence::default() },
            request,
            earlier: Vec::new(),
            scale_supported: true,
            seen: Vec::new(),
        }
    }

    fn predicted_pose(&self, snapshot: &Snapshot, predicted: &NavEstimate) -> Option<AnchoredPose> {
        let (reference, _) = snapshot.surviving_ancestor(self.last.as_ref()?.anchored.reference)?;
        anchored_at(snapshot, reference, predicted.world_from_camera)
    }

    /// An offer that begins a world, with what the inertial sensor says of it.
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

    /// A new world, when tracking has been lost for a while: nothing is thrown away, the former one stays and waits to
    /// be recognised. It begins where the eye was last known to be, with an uncertainty that grows with the time since.
    pub(crate) fn begin_anew(&mut self, frame: Arc<Frame>, snapshot: &Snapshot) -> Option<KeyFrameRequest> {
        self.wait(&frame);
        let since = self.located.max(self.map_created)?;
        if frame.stamp - since < self.config.new_map_s {
            return None;
        }
        let request = self.starter.step(&self.camera, &frame, self.features).ok()?;
        let mut request = self.with_imu_segment(request);
        if let KeyFrameRequest::First { frame: root, relocation_prior, .. }
        | KeyFrameRequest::Pair { first: root, relocation_prior, .. } = &mut request
        {
            *relocation_prior = self.relocation_prior(root, snapshot);
        }
        Some(request)
    }

    fn relocation_prior(&self, frame: &Frame, snapshot: &Snapshot) -> Option<RelocationPrior> {
        let last = self.last.as_ref()?;
        let predicted = self.inertial.as_ref().and_then(|i| i.predict(frame.stamp));
        if let Some(predicted) = predicted.filter(|f| f.world_from_camera.is_finite()) {
            let anchored = anchored_at(
                snapshot,
                snapshot.surviving_ancestor(last.anchored.reference)?.0,
                predicted.world_from_camera,
            )?;
            let (sigma, sigma_rad) = (predicted.place_sigma(), predicted.turn_sigma());
            return Some(RelocationPrior {
                anchored,
                sigma,
                sigma_rad,
                pace: self.pace(),
                sigma_log_scale: self.sigma_log_scale(),
                level: true,
            });
        }
        let unseen_s = frame.stamp - last.frame.stamp;
        // Where the view ran out of features the motion goes on for a while; a sudden loss says nothing of it.
        let goes_on_s = if self.ran_out(last) { unseen_s.clamp(0.0, BLANK_S) } else { 0.0 };
        let moved = self.velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * goes_on_s)));
        let believed = last.anchored.world_from_camera * moved;
        let anchored =
            anchored_at(snapshot, snapshot.surviving_ancestor(last.anchored.reference)?.0, believed)?;
        let (sigma, sigma_rad) = (self.fastest() * unseen_s, UNSEEN_TURN * unseen_s);
        Some(RelocationPrior {
            anchored,
            sigma,
            sigma_rad,
            pace: self.pace(),
            sigma_log_scale: self.sigma_log_scale(),
            level: false,
        })
    }

    /// How badly the scale of a map that begins now is known against the one before, as a standard deviation of its logarithm.
    pub(crate) fn sigma_log_scale(&self) -> f64 {
        match (self.camera.has_depth(), self.pace()) {
            (true, _) => 0.0,
            (false, Some(_)) => PACE_SIGMA[0],
            (false, None) => NO_PACE_SIGMA,
        }
    }

    /// About a metre in the map's unit: without metric scale the pace so far tells how long it is.
    pub(crate) fn metre(&self) -> f64 {
        if self.camera.has_depth() { 1.0 } else { self.pace().unwrap_or(1.0) / UNSEEN_SPEED }
    }

    /// How fast the eye may move while nothing is seen, in the map's unit a second: as someone on foot, or as before if that
    /// was faster.
    fn fastest(&self) -> f64 {
        (UNSEEN_SPEED * self.metre()).max(self.pace().unwrap_or(0.0))
    }

    /// Whether the eye can have come to a place in the world of a key frame since it last knew where it was: rooms that look
    /// alike are told apart by that. Into another world, or a map that was loaded, appearance alone has to lead.
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
        let gone = (place.translation - last.anchored.world_from_camera.translation).norm();
        gone <= 2.0 * self.fastest() * (stamp - last.frame.stamp) + DRIFTED * self.metre()
    }

    /// How fast the walker goes when he walks, in the map's unit a second.
    pub(crate) fn pace(&self) -> Option<f64> {
        self.pace.walking().map(|(pace, _)| pace)
    }

    /// Past a blank wall: once there is something with depth to see again, it enters the map where the motion before
    /// the gap leads. The frame itself counts as lost; the next ones are tracked from it. Only where the view had
    /// run out of features: a sudden motion is no ground for going on as before.
    pub(crate) fn bridge(&mut self, frame: Arc<Frame>, snapshot: &Snapshot) -> Option<KeyFrameRequest> {
        let last = self.last.as_ref()?;
        let blank = self.camera.has_depth() && self.ran_out(last);
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
        self.since_key_frame = 0;
        let imu = self.inertial.as_mut().map(|i| i.sense(frame.stamp));
        Some(KeyFrameRequest::Next {
            frame,
            landmarks,
            anchored,
            imu,
            orientation_only: false,
            rescale: None,
        })
    }

    /// Whether the last view had run out of features: a blank wall.
    fn ran_out(&self, last: &Last) -> bool {
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
            evidence,
            request: None,
            earlier: Vec::new(),
            scale_supported: !self.scale_support.is_lost(),
            seen: Vec::new(),
        }
    }
}
