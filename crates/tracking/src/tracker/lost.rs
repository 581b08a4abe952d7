//! Too few matches: the IMU or another measured motion carries the pose for a while (coasting), and after that tracking is lost.

use super::{Miss, Now, Tracker};
use crate::on_the_spot::PureRotation;
use crate::reckoned::Estimate;
use crate::state::{AnchoredPose, Evidence, KeyFrameRequest, Last, State, Tracked, anchored_at};
use cairn_geometry::Se3;

/// Seconds between key frames while coasting.
const COAST_KEY_FRAME_S: f64 = 0.25;

impl Tracker {
    /// Handles a frame with too few matches: coasts on what else measures the motion while that is accurate enough, else tracking
    /// is lost.
    pub(super) fn miss(&mut self, now: &Now, miss: Miss) -> Tracked {
        if miss.is_final {
            return self.lose(now, miss.inliers);
        }
        let stamp = now.frame.stamp;
        self.priors.align(now.snapshot, stamp);
        let spot = self.hold_on_the_spot(now);
        let carried = self.priors.carry(self.last.as_ref(), stamp);
        let carried = carried.and_then(|c| Some((self.at_last_reference(now, &c.world_from_camera)?, c)));
        match carried {
            Some((anchored, estimate)) => self.coast(now, miss.inliers, anchored, &estimate, spot),
            None => self.track_rotation(now).unwrap_or_else(|| self.lose(now, miss.inliers)),
        }
    }

    /// Corrects what the readings predict where the images say that the camera turns on the spot; whether they do.
    fn hold_on_the_spot(&mut self, now: &Now) -> PureRotation {
        let carried = self.priors.carry_by_imu(now.frame.stamp).filter(|_| !self.setup.camera.has_depth());
        let Some(carried) = carried else { return PureRotation::No };
        let rotation = &carried.world_from_camera.rotation;
        let spot = self.spot.step(&self.setup.camera, now.frame, rotation);
        if let (PureRotation::New, Some(inertial)) = (spot, &mut self.priors.inertial) {
            inertial.hold();
        }
        spot
    }

    /// Goes on with a pose that features have not given.
    fn coast(
        &mut self,
        now: &Now,
        inliers: usize,
        anchored: AnchoredPose,
        estimate: &Estimate,
        spot: PureRotation,
    ) -> Tracked {
        let frame = now.frame;
        self.mode.coast();
        self.priors.velocity.forget();
        let since_s = self.clock.located.map_or(0.0, |t| frame.stamp - t);
        let is_due = self
            .coast_by_imu(now, &anchored, spot)
            .unwrap_or(self.clock.since_key_frame as f64 >= COAST_KEY_FRAME_S * self.setup.rate_hz);
        let is_wanted = is_due && now.idle && self.setup.usable(frame) >= self.setup.need_of_new();
        let request = is_wanted.then(|| {
            // Views that differ by a rotation alone tell no depth.
            let orientation_only = spot != PureRotation::No;
            let inertial = self.priors.inertial.as_mut();
            let imu = inertial.map(|inertial| inertial.carried_segment(frame.stamp, spot));
            self.begin_key_frame(now, anchored);
            KeyFrameRequest::carried(frame.clone(), anchored, imu, orientation_only)
        });
        let Estimate { sigma, covariance, .. } = *estimate;
        let evidence = Evidence { features: frame.len(), inliers, ..Evidence::default() };
        Tracked {
            pose: Some(anchored),
            covariance: Some(covariance),
            request,
            ..Tracked::without_pose(frame.stamp, State::Coasting { since_s, sigma }, evidence)
        }
    }

    /// The readings carry the pose: whether a key frame is due; `None` where something else does.
    fn coast_by_imu(&mut self, now: &Now, anchored: &AnchoredPose, spot: PureRotation) -> Option<bool> {
        let stamp = now.frame.stamp;
        self.priors.carry_by_imu(stamp)?;
        let is_held = self.priors.is_aligned() || spot != PureRotation::No;
        let inertial = self.priors.inertial.as_mut()?;
        inertial.coast(stamp, anchored, is_held);
        Some(inertial.filter.seconds_since_request(stamp).is_none_or(|s| s >= COAST_KEY_FRAME_S))
    }

    /// A frame whose pose features have not given becomes a key frame.
    fn begin_key_frame(&mut self, now: &Now, anchored: AnchoredPose) {
        self.last = Some(Last::without_landmarks(now.frame.clone(), anchored));
        self.priors.measured.restart(false);
        self.clock.since_key_frame = 0;
    }

    fn at_last_reference(&self, now: &Now, world_from_camera: &Se3) -> Option<AnchoredPose> {
        anchored_at(now.snapshot, self.last.as_ref()?.reference(now.snapshot)?, *world_from_camera)
    }

    /// The pose of a frame is not known.
    pub(crate) fn lose(&mut self, now: &Now, inliers: usize) -> Tracked {
        self.mode.lose();
        let evidence = Evidence { features: now.frame.len(), inliers, ..Evidence::default() };
        let state = State::Lost { inliers, need: self.setup.config.min_inliers };
        Tracked {
            scale_supported: self.unit.is_supported(),
            ..Tracked::without_pose(now.frame.stamp, state, evidence)
        }
    }
}
