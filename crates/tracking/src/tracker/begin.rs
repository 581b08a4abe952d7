//! Maps that begin: the first one, one where tracking was lost in the one before, and one with a unit of length of its own where
//! that of the one before has lost its support.

use super::{BLANK_S, Now, Tracker};
use crate::first_clocks::Known;
use crate::shutter::Shutter;
use crate::state::{Evidence, KeyFrameRequest, RelocationPrior, State, Tracked, anchored_at};
use cairn_atlas::Snapshot;
use cairn_geometry::Se3;
use cairn_vision::Frame;
use std::sync::Arc;

/// How far the rotation between two views may be from what the gyroscope has measured where the lens is a guess: radians, and per
/// radian (`phone/b`: 0.016 of 0.24).
const OFF_RAD: [f64; 2] = [0.02, 0.15];

impl Tracker {
    /// A frame while there is no map: perhaps one begins with it.
    pub(super) fn begin_first_map(&mut self, frame: Arc<Frame>, snapshot: &Snapshot) -> Tracked {
        self.odometry.miss();
        let features = frame.len();
        self.start.wait(&frame);
        let waits = State::Starting { have: features, need: 0 };
        let begun = match self.knows_clocks(&frame, snapshot) {
            true => {
                let newest = self.start.newest().cloned().unwrap_or_else(|| frame.clone());
                self.start.step(&newest)
            }
            false => Err(waits),
        };
        let (state, request) = match begun {
            Ok(request) if self.contradicts_gyroscope(&request) => (waits, None),
            Ok(request) => {
                let mut request = self.priors.with_imu_data(request);
                if let KeyFrameRequest::Pair { clocks, .. } = &mut request {
                    *clocks = self.start.flow;
                }
                (waits, Some(request))
            }
            Err(state) => (state, None),
        };
        self.clock.since_key_frame = 0;
        let evidence = Evidence { features, ..Evidence::default() };
        Tracked { request, ..Tracked::without_pose(frame.stamp, state, evidence) }
    }

    /// Whether two views do not differ by the rotation that the gyroscope has measured between them, once its clock is known: what
    /// looks like parallax there is something else.
    fn contradicts_gyroscope(&self, request: &KeyFrameRequest) -> bool {
        let KeyFrameRequest::Pair { first, second, first_from_second, .. } = request else { return false };
        let known = self.priors.inertial.as_ref().filter(|_| self.start.flow.is_some());
        let Some(turned) = known.and_then(|i| i.filter.turned(first.stamp, second.stamp)) else {
            return false;
        };
        let off = (turned.inverse() * first_from_second.rotation).angle();
        off > OFF_RAD[0] + OFF_RAD[1] * turned.angle()
    }

    /// Whether nothing more is waited for of clocks and rows before a map may begin. Once they are known, what was seen until then is
    /// corrected by them.
    fn knows_clocks(&mut self, frame: &Arc<Frame>, snapshot: &Snapshot) -> bool {
        let wanted = self.setup.config.clocks_by_flow
            && self.shutter.is_estimated()
            && !self.setup.camera.has_depth()
            && self.start.flow.is_none();
        let Some(inertial) = self.priors.inertial.as_mut().filter(|_| wanted) else { return true };
        let filter = &mut inertial.filter;
        let camera_from_imu = filter.imu_from_camera.rotation.inverse();
        let known = match self.setup.config.clocks {
            Some(given) => Known::Now(given),
            None => {
                let (camera, samples) = (&self.setup.camera, filter.samples());
                self.start.clocks.step(camera, &self.shutter, frame, samples, &camera_from_imu)
            }
        };
        match known {
            Known::Ended => true,
            Known::NotYet => {
                self.start.follow(frame);
                false
            }
            Known::Now(flow) => {
                filter.shift_to(flow.offset_s[0]);
                // A map begins with a frame since which all readings are there.
                let from = filter.samples().next().map(|s| s.stamp);
                self.start.flow = Some(flow);
                let mut waiting = self.start.restart();
                for seen in &mut waiting {
                    Shutter::undo(Arc::make_mut(seen), &self.setup.camera);
                    *seen = self.at_middle_row(seen.clone(), snapshot);
                }
                self.start.resume(waiting, from);
                true
            }
        }
    }

    /// Begins a new map when tracking has been lost for a while. Nothing is discarded: the previous map stays and can
    /// be recognised later. The new map begins at the last known pose, with an uncertainty that grows with the time
    /// since.
    pub(crate) fn begin_new_map(&mut self, now: &Now) -> Option<KeyFrameRequest> {
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
