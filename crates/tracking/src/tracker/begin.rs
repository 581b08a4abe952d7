//! Maps that begin: the first one, one where tracking was lost in the one before, and one with a unit of length of its own where
//! that of the one before has lost its support.

use super::{BLANK_S, Now, Tracker};
use crate::state::{Evidence, KeyFrameRequest, RelocationPrior, State, Tracked, anchored_at};
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_vision::Frame;
use std::sync::Arc;

impl Tracker {
    /// A frame while there is no map: perhaps one begins with it.
    pub(super) fn begin_first_map(&mut self, frame: Arc<Frame>) -> Tracked {
        self.odometry.miss();
        let features = frame.len();
        self.start.wait(&frame);
        let (state, request) = match self.start.step(&frame) {
            Ok(request) => {
                (State::Starting { have: features, need: 0 }, Some(self.priors.with_imu_data(request)))
            }
            Err(state) => (state, None),
        };
        self.clock.since_key_frame = 0;
        let evidence = Evidence { features, ..Evidence::default() };
        Tracked { request, ..Tracked::without_pose(frame.stamp, state, evidence) }
    }

    /// Begins a new map when tracking has been lost for a while. Nothing is discarded: the previous map stays and can
    /// be recognised later. The new map begins at the last known pose, with an uncertainty that grows with the time
    /// since.
    pub(super) fn begin_new_map(&mut self, now: &Now) -> Option<KeyFrameRequest> {
        let frame = now.frame;
        self.start.wait(frame);
        let since = self.clock.located.max(self.clock.map_created)?;
        if frame.stamp - since < self.setup.config.new_map_s {
            return None;
        }
        let request = self.start.step(frame).ok()?;
        let mut request = self.priors.with_imu_data(request);
        match &mut request {
            KeyFrameRequest::First { frame, relocation_prior, .. } => {
                *relocation_prior = self.relocation_prior(frame, now.snapshot);
            }
            KeyFrameRequest::Pair { first, second, relocation_prior, .. } => {
                let speed = self.unit.assumed_speed(first.stamp, second.stamp);
                let prior = self.relocation_prior(first, now.snapshot);
                *relocation_prior = prior.map(|prior| RelocationPrior { speed, ..prior });
            }
            KeyFrameRequest::Next { .. } => {}
        }
        Some(request)
    }

    /// Begins a new map with its own unit of length, once two views since the loss of scale support have parallax:
    /// the further route is then not measured with the assumed depths that carried the orientation through the turn.
    pub(super) fn begin_with_own_scale(&mut self, now: &Now) -> Option<KeyFrameRequest> {
        let request = self.start.step(now.frame).ok()?;
        let mut request = self.priors.with_imu_data(request);
        if let KeyFrameRequest::Pair { first, second, relocation_prior, .. } = &mut request {
            let speed = self.unit.assumed_speed(first.stamp, second.stamp);
            let prior = self.unit.rotation_prior(first.stamp, now.snapshot)?;
            *relocation_prior = Some(RelocationPrior { speed, ..prior });
        }
        Some(request)
    }

    /// Where the new map is in the one before, by the first that can tell: the turn that carried the orientation, the IMU, the depth
    /// or a measured motion, and else the last pose and velocity.
    fn relocation_prior(&self, frame: &Frame, snapshot: &Snapshot) -> Option<RelocationPrior> {
        if let Some(prior) = self.unit.rotation_prior(frame.stamp, snapshot) {
            return Some(prior);
        }
        let last = self.last.as_ref()?;
        let prior = |pose: Se3, [sigma, sigma_rad]: [f64; 2]| {
            Some(RelocationPrior {
                anchored: anchored_at(snapshot, last.reference(snapshot)?, pose)?,
                sigma,
                sigma_rad,
                speed: None,
                sigma_log_scale: self.unit.sigma_log_scale(),
                gravity_aligned: false,
                assumed_since: None,
            })
        };
        let predicted = self.priors.inertial.as_ref().and_then(|i| i.filter.predict(frame.stamp));
        if let Some(f) = predicted.filter(|f| f.world_from_camera.is_finite()) {
            let known = prior(f.world_from_camera, [f.position_sigma(), f.rotation_sigma()])?;
            return Some(RelocationPrior { gravity_aligned: true, ..known });
        }
        if let Some(reckoned) = self.priors.reckoned(Some(last)) {
            return prior(reckoned.world_from_camera, reckoned.sigma());
        }
        let untracked_s = frame.stamp - last.frame.stamp;
        // Where the view ran out of features, the motion is assumed to continue for a while; a sudden loss does not
        // justify that assumption.
        let extrapolated_s =
            if self.setup.is_blank(&last.frame) { untracked_s.clamp(0.0, BLANK_S) } else { 0.0 };
        let moved = self.priors.velocity.over(extrapolated_s).unwrap_or(Se3::identity());
        let assumed = prior(
            last.anchored.world_from_camera * moved,
            [
                self.unit.max_plausible_speed() * untracked_s,
                self.setup.config.motion.fastest_turn_rad_s * untracked_s,
            ],
        )?;
        Some(RelocationPrior { assumed_since: self.unit.support.assumed_since(), ..assumed })
    }
}
