//! Constant velocity: the camera moves on as it did between the last two frames; it turns as the gyroscope says, where there is
//! one.

use super::{Correction, MotionPrior};
use crate::state::Last;
use cairn_geometry::{Manifold, Se3, So3, Vec3};
use cairn_sensor::Stamp;
use nalgebra::Vector6;

/// The velocity of the camera along its own axes.
#[derive(Clone, Debug, Default)]
pub(crate) struct ConstantVelocity {
    /// Metres or map units per second, radians per second; when the last two frames had a pose.
    known: Option<Vector6<f64>>,
    /// By how much the camera has turned since the last pose, by the gyroscope.
    turned: Option<So3>,
}

impl ConstantVelocity {
    /// The velocity, when the last two frames had a pose.
    pub fn known(&self) -> Option<&Vector6<f64>> {
        self.known.as_ref()
    }

    /// The camera's angular velocity along its own axes, rad/s.
    pub fn turning(&self) -> Option<Vec3> {
        self.known.map(|v| v.fixed_rows::<3>(3).into_owned())
    }

    /// The gyroscope says how the camera has turned up to the frame that is tracked; returns what it said before.
    pub fn turned(&mut self, turned: Option<So3>) -> Option<So3> {
        std::mem::replace(&mut self.turned, turned)
    }

    /// The motion in so many seconds, by the velocity alone; `None` where that is not known.
    pub fn over(&self, seconds: f64) -> Option<Se3> {
        self.known.map(|v| Se3::exp(&(v * seconds)))
    }

    /// Nothing is known of it.
    pub fn forget(&mut self) {
        self.known = None;
    }

    /// The camera turns on the spot, at this rate along its own axes, rad/s.
    pub fn turns(&mut self, rate: Vec3) {
        let mut velocity = Vector6::zeros();
        velocity.fixed_rows_mut::<3>(3).copy_from(&rate);
        self.known = Some(velocity);
    }

    /// Converts to a new unit of length: all lengths were multiplied by this factor.
    pub fn rescale(&mut self, factor: f64) {
        if let Some(v) = &mut self.known {
            v.fixed_rows_mut::<3>(0).scale_mut(factor);
        }
    }
}

impl MotionPrior for ConstantVelocity {
    fn predict(&self, last: Option<&Last>, stamp: Stamp) -> Option<Se3> {
        let last = last?;
        let mut moved = self.over(stamp - last.frame.stamp).unwrap_or(Se3::identity());
        if let Some(turned) = self.turned {
            moved.rotation = turned;
        }
        Some(last.anchored.world_from_camera * moved)
    }

    fn correct(&mut self, at: &Correction) {
        self.known = at.before.map(|(before, s)| before.local(&at.anchored.world_from_camera) / s);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::AnchoredPose;
    use cairn_atlas::KeyFrameId;
    use cairn_vision::Frame;
    use std::sync::Arc;

    fn last() -> Last {
        let at = Se3::new(So3::exp(&(Vec3::y() * 0.3)), Vec3::new(1.0, 0.0, 2.0));
        let mut frame = Frame::default();
        frame.stamp = Stamp::from_seconds(4.0);
        Last {
            frame: Arc::new(frame),
            landmarks: Vec::new(),
            anchored: AnchoredPose::at(KeyFrameId::FIRST, at),
        }
    }

    #[test]
    fn the_camera_goes_on_along_its_own_axes_and_turns_as_the_gyroscope_says() {
        let (last, now) = (last(), Stamp::from_seconds(4.5));
        let mut prior = ConstantVelocity::default();
        assert!(prior.predict(None, now).is_none(), "nobody knows from where");
        let at = last.anchored.world_from_camera;
        assert_eq!(prior.predict(Some(&last), now), Some(at), "it stays where nothing is known");
        prior.known = Some(Vector6::new(0.0, 0.0, 0.8, 0.0, 0.2, 0.0));
        let moved = at.inverse() * prior.predict(Some(&last), now).unwrap();
        assert!((moved.rotation.log() - Vec3::y() * 0.1).norm() < 1e-12, "{moved:?}");
        assert!((moved.translation.z - 0.4).abs() < 1e-3 && moved.translation.x > 0.0, "{moved:?}");
        let turned = So3::exp(&(Vec3::x() * 0.25));
        prior.turned(Some(turned));
        let both = at.inverse() * prior.predict(Some(&last), now).unwrap();
        assert!((both.rotation.inverse() * turned).angle() < 1e-12);
        assert!((both.translation - moved.translation).norm() < 1e-12);
    }

    #[test]
    fn a_turn_on_the_spot_goes_nowhere_and_a_new_unit_changes_lengths_alone() {
        let (last, now) = (last(), Stamp::from_seconds(4.5));
        let mut prior = ConstantVelocity::default();
        prior.turns(Vec3::y() * 0.4);
        let predicted = prior.predict(Some(&last), now).unwrap();
        assert_eq!(predicted.translation, last.anchored.world_from_camera.translation);
        assert_eq!(prior.turning(), Some(Vec3::y() * 0.4));
        prior.known = Some(Vector6::new(1.0, 2.0, 3.0, 0.1, 0.2, 0.3));
        prior.rescale(2.0);
        assert_eq!(prior.known(), Some(&Vector6::new(2.0, 4.0, 6.0, 0.1, 0.2, 0.3)));
        prior.forget();
        assert!(prior.over(1.0).is_none());
    }
}
