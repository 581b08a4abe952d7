//! The IMU as a prior: the state that its readings predict for the frame that is tracked ([`InertialFilter`]).
//!
//! It is the first guess, a prior of the pose, and the pose itself while it is sure enough. What else is known of the motion
//! before features are looked at (the shape of a surface, that the camera turns on the spot) corrects that state.

use super::{Correction, MotionPrior};
use crate::imu::InertialFilter;
use crate::odometry::MotionSource;
use crate::on_the_spot::PureRotation;
use crate::reckoned::{Estimate, Reckoned, tracked_covariance};
use crate::state::{AnchoredPose, KeyFrameRequest, Last, anchored_at};
use cairn_adjust::{Located, MotionSince};
use cairn_atlas::ImuSegment;
use cairn_geometry::{Manifold, Se3, Vec3};
use cairn_inertial::NavEstimate;
use cairn_sensor::Stamp;
use cairn_solve::PosePrior;
use nalgebra::Matrix6;

/// Greatest standard deviation of the direction of gravity for a search that relies on it.
const UP_SIGMA_RAD: f64 = 0.05;

/// Variance of a translation of which nothing is known, in the map's unit squared.
const ANYWHERE_M2: f64 = 1e6;
/// How well the gyroscope tells how far the camera has turned in its pictures where the lens is a guess: radians, and per radian.
const TURNED_BY_GYRO: [f64; 2] = [0.005, 0.05];

/// The filter, and what it predicts for the frame that is tracked.
#[derive(Debug)]
pub(crate) struct InertialPrior {
    pub filter: InertialFilter,
    predicted: Option<NavEstimate>,
    /// The camera's motion since the frame before.
    moved: Option<Se3>,
    /// Standard deviation of the position in metres, and seconds in motion, up to which it may carry the pose.
    limit: (f64, f64),
}

impl InertialPrior {
    /// `limit`: the standard deviation of the position in metres, and the seconds in motion, up to which the readings may
    /// carry the pose.
    pub fn new(filter: InertialFilter, limit: (f64, f64)) -> Self {
        Self { filter, predicted: None, moved: None, limit }
    }

    /// Remembers the motion since the frame of `from`, if that is the last one.
    pub fn measure(&mut self, from: Option<Stamp>, stamp: Stamp) {
        self.moved = from.and_then(|from| self.filter.moved(from, stamp));
    }

    /// Predicts the state in a frame, from the readings alone.
    pub fn begin(&mut self, stamp: Stamp) {
        self.predicted = self.filter.predict(stamp);
    }

    /// The place was found without it: what it predicts counts for nothing.
    pub fn disregard(&mut self) {
        self.predicted = None;
    }

    /// The same for a while.
    pub fn set_aside(&mut self) -> Option<NavEstimate> {
        self.predicted.take()
    }

    /// It counts again.
    pub fn put_back(&mut self, predicted: Option<NavEstimate>) {
        self.predicted = predicted;
    }

    /// The state in the frame that is tracked.
    pub fn predicted(&self) -> Option<&NavEstimate> {
        self.predicted.as_ref()
    }

    /// Whether the state is predicted from one in which the camera was tracked.
    pub fn predicts_from_tracked(&self) -> bool {
        self.predicted.is_some() && self.filter.carried_since().is_none()
    }

    /// By how much the camera has turned between two key frames; nothing of how far it has moved. A map that has no scale by the
    /// readings yet would else bend where it turns, and take the bend for a near wall.
    pub fn turned_since(&self, before: Stamp, stamp: Stamp) -> Option<MotionSince> {
        let turned = self.filter.turned(before, stamp)?;
        let sigma = TURNED_BY_GYRO[0] + TURNED_BY_GYRO[1] * turned.angle();
        let since_from_now = Se3::new(turned, Vec3::zeros());
        Some(MotionSince { stamp: before, since_from_now, variance: [ANYWHERE_M2, sigma * sigma] })
    }

    /// Another pose of the same frame corrects the predicted state.
    pub fn see(&mut self, reckoned: &Reckoned) {
        let Some(predicted) = self.predicted.take() else { return };
        let seen = predicted.seen(&reckoned.world_from_camera, &reckoned.covariance);
        self.predicted = seen.or(Some(predicted));
    }

    /// The images say that the camera turns on the spot.
    pub fn hold(&mut self) {
        if let Some(held) = self.predicted.as_ref().and_then(InertialFilter::on_the_spot) {
            self.predicted = Some(held);
        }
    }

    /// Takes the predicted state for a frame that features could not locate; `is_held` where something else corrected it.
    pub fn coast(&mut self, stamp: Stamp, anchored: &AnchoredPose, is_held: bool) {
        if let Some(predicted) = self.predicted.take() {
            self.filter.coast(stamp, anchored, predicted, is_held);
        }
    }

    /// The direction against gravity in the camera, where a map that is aligned with gravity tells it.
    pub fn up(&self, stamp: Stamp) -> Option<Vec3> {
        let predicted = self.filter.predict(stamp)?;
        let turn = predicted.world_from_camera.rotation;
        let up = turn.inverse() * Vec3::z();
        // Turning about the vertical does not change it.
        let of_turn = predicted.pose_covariance().fixed_view::<3, 3>(3, 3).into_owned();
        let variance = of_turn.trace() - up.dot(&(of_turn * up));
        (up.iter().all(|v| v.is_finite()) && variance < UP_SIGMA_RAD * UP_SIGMA_RAD).then_some(up)
    }

    /// Since when the readings alone have led to where the camera is believed to be, if a pose by features cannot be there: the
    /// landmarks made on the way say nothing then, they are where that estimate put them. The estimate becomes uncertain as the
    /// walker goes on, so that nobody is shut out for good.
    pub fn contradicted_since(&self, located: &Located, prior: &PosePrior) -> Option<Stamp> {
        self.filter.carried_since().filter(|_| self.contradicts(located, prior))
    }

    /// Whether matches lead elsewhere than the readings do.
    pub fn contradicts(&self, located: &Located, prior: &PosePrior) -> bool {
        let Some(predicted) = &self.predicted else { return false };
        let Some((alone, own)) = without_prior(located, prior) else { return false };
        let carried = Reckoned {
            world_from_camera: predicted.world_from_camera,
            covariance: predicted.pose_covariance() + own + tracked_covariance(),
            limit: [f64::INFINITY; 2],
        };
        !carried.agrees(&alone)
    }

    /// The IMU data of a key frame whose pose is only carried; `spot` says whether the camera turns on the spot.
    pub fn carried_segment(&mut self, stamp: Stamp, spot: PureRotation) -> ImuSegment {
        let still_sigma = self.filter.still_sigma(stamp, spot);
        ImuSegment { still_sigma, ..self.filter.take_segment(stamp) }
    }

    /// A request that begins a map, with the IMU data added.
    pub fn added_to(&self, mut request: KeyFrameRequest) -> KeyFrameRequest {
        match &mut request {
            KeyFrameRequest::First { frame, imu, .. } => {
                *imu = Some(self.filter.segment_since(None, frame.stamp));
            }
            KeyFrameRequest::Pair { first, second, imu, .. } => {
                *imu = Some(self.filter.segment_since(Some(first.stamp), second.stamp));
            }
            KeyFrameRequest::Next { .. } => {}
        }
        request
    }
}

impl MotionPrior for InertialPrior {
    fn predict(&self, _: Option<&Last>, _: Stamp) -> Option<Se3> {
        Some(self.predicted.as_ref()?.world_from_camera)
    }

    fn carry(&self, _: Option<&Last>, stamp: Stamp) -> Option<Estimate> {
        let (predicted, (sigma_m, seconds)) = (self.predicted.as_ref()?, self.limit);
        let may = predicted.world_from_camera.is_finite()
            && predicted.position_sigma() <= sigma_m
            && self.filter.carried_s(stamp) <= seconds;
        may.then(|| Estimate {
            world_from_camera: predicted.world_from_camera,
            sigma: predicted.position_sigma(),
            covariance: predicted.pose_covariance(),
        })
    }

    fn prior(&self, _: Option<&Last>, _: Stamp) -> Option<PosePrior> {
        let predicted = self.predicted.as_ref()?;
        let information = predicted.pose_information()?;
        Some(PosePrior { world_from_camera: predicted.world_from_camera, information })
    }

    fn relative(&self) -> Option<(Se3, MotionSource)> {
        self.moved.map(|moved| (moved, MotionSource::Imu))
    }

    fn correct(&mut self, at: &Correction) {
        // The IMU prior is part of the pose; the time offset and the readings must be judged by vision alone.
        let alone = at.prior.and_then(|prior| without_prior(at.located, prior));
        let alone = alone.map_or(at.anchored.world_from_camera, |(alone, _)| alone);
        if self.filter.wants_rotations(at.stamp) {
            self.filter.add_rotation(at.stamp, alone.rotation);
        }
        let alone = anchored_at(at.snapshot, at.anchored.reference, alone).unwrap_or(*at.anchored);
        let fails = self.filter.see(at.snapshot, at.stamp, &alone);
        let predicted = self.predicted.as_ref().filter(|_| !fails);
        self.filter.update(at.snapshot, at.stamp, at.anchored, predicted, &at.located.information);
    }
}

/// The pose without the prior, and its covariance: at the solution the gradients of the prior and of the observations cancel.
fn without_prior(located: &Located, prior: &PosePrior) -> Option<(Se3, Matrix6<f64>)> {
    let gradient = prior.information * prior.world_from_camera.local(&located.world_from_camera);
    let own = (located.information - prior.information).cholesky()?;
    Some((located.world_from_camera.retract(&own.solve(&gradient)), own.inverse()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_tests::{begun, readings, truth};
    use crate::synthetic::off;
    use cairn_geometry::So3;

    /// The prior 0.5 s after the walk of a map that is aligned with gravity, with these limits.
    fn half_a_second_on(limit: (f64, f64)) -> (InertialPrior, Stamp) {
        let (_, _, filter, _) = begun(&readings(2.0, 2.6));
        let (mut prior, now) = (InertialPrior::new(filter, limit), Stamp::from_seconds(2.5));
        prior.begin(now);
        (prior, now)
    }

    #[test]
    fn the_readings_predict_the_pose_and_carry_it_within_their_limits() {
        let (prior, now) = half_a_second_on((1.0, 6.0));
        let predicted = prior.predict(None, now).expect("readings");
        assert!(off(&predicted, &truth(2.5)).0 < 0.02, "{predicted:?}");
        let carried = prior.carry(None, now).expect("sure enough");
        assert!(carried.world_from_camera == predicted && carried.sigma > 0.0 && carried.sigma < 0.1);
        let known = prior.prior(None, now).expect("a prior");
        assert!(known.world_from_camera == predicted && known.information.trace() > 0.0);
        assert!(half_a_second_on((1e-4, 6.0)).0.carry(None, now).is_none(), "too unsure");
        assert!(half_a_second_on((1.0, 0.3)).0.carry(None, now).is_none(), "too long");
    }

    #[test]
    fn another_pose_of_the_frame_corrects_the_prediction_and_a_place_found_without_it_ends_it() {
        let (mut prior, now) = half_a_second_on((1.0, 6.0));
        let before = prior.carry(None, now).expect("sure").sigma;
        let moved = truth(2.5) * Se3::new(So3::identity(), Vec3::x() * 0.02);
        let covariance = Matrix6::identity() * 1e-8;
        prior.see(&Reckoned { world_from_camera: moved, covariance, limit: [1.0; 2] });
        let corrected = prior.carry(None, now).expect("sure");
        assert!(off(&corrected.world_from_camera, &moved).0 < 1e-3, "{corrected:?}");
        assert!(corrected.sigma < before, "{} {before}", corrected.sigma);
        prior.disregard();
        assert!(prior.predict(None, now).is_none() && prior.carry(None, now).is_none());
    }

    #[test]
    fn the_motion_since_the_last_frame_is_measured_from_that_alone() {
        let (_, _, filter, _) = begun(&readings(2.0, 2.6));
        let mut prior = InertialPrior::new(filter, (1.0, 6.0));
        let at = Stamp::from_seconds;
        prior.measure(Some(at(2.0)), at(2.2));
        let (moved, source) = prior.relative().expect("readings");
        assert_eq!(source, MotionSource::Imu);
        assert!(off(&moved, &(truth(2.0).inverse() * truth(2.2))).0 < 0.01, "{moved:?}");
        for from in [None, Some(at(1.9))] {
            prior.measure(from, at(2.2));
            assert!(prior.relative().is_none(), "{from:?} is not the last frame");
        }
    }
}
