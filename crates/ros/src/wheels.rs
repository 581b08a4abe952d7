//! Odometry of the wheels: from readings to the robot's motion between two pictures.
//!
//! Readings are poses of the robot in a frame that drifts, at times of their own. The pose at a picture is interpolated between two of
//! them, or goes on for a moment with the last velocity, since a reading may come later than its picture.

use cairn::Stamp;
use cairn::engine::MeasuredMotion;
use cairn::geometry::Se3;
use std::collections::VecDeque;

/// Readings kept at most: of 200 Hz, some seconds.
const MOST: usize = 1000;
/// Seconds between two readings above which the motion between them is not known.
const GAP_S: f64 = 0.2;
/// Seconds after the last reading for which its velocity goes on.
const ON_S: f64 = 0.06;
/// Standard deviations: per metre or radian of the motion, and at least, in metres and radians: wheels slip, and a chassis nods.
const SIGMA: [f64; 2] = [0.1, 0.002];

/// The readings so far.
#[derive(Clone, Debug, Default)]
pub struct Wheels {
    readings: VecDeque<(Stamp, Se3)>,
    /// The pose at the picture before.
    last: Option<Se3>,
}

impl Wheels {
    /// Takes a reading. Where its time does not go on, the motion up to it is not known.
    pub fn add(&mut self, stamp: Stamp, odom_from_base: Se3) {
        if self.readings.back().is_some_and(|(before, _)| *before >= stamp) {
            (self.readings, self.last) = (VecDeque::new(), None);
        }
        if self.readings.len() >= MOST {
            self.readings.pop_front();
        }
        self.readings.push_back((stamp, odom_from_base));
    }

    /// The motion of the robot from the picture before to that of this time, in its own frame, with its standard deviations; `None`
    /// where it was not measured.
    pub fn motion_to(&mut self, picture: Stamp) -> Option<MeasuredMotion> {
        let now = self.at(picture);
        // Only the readings around the next picture are needed.
        let old = self.readings.iter().filter(|(stamp, _)| *stamp < picture).count().saturating_sub(2);
        self.readings.drain(..old);
        let before = std::mem::replace(&mut self.last, now)?;
        let last_from_now = before.inverse() * now?;
        let sizes = [last_from_now.translation.norm(), last_from_now.rotation.angle()];
        let [sigma_m, sigma_rad] = sizes.map(|size| SIGMA[0] * size + SIGMA[1]);
        Some(MeasuredMotion { last_from_now, sigma_m, sigma_rad })
    }

    fn at(&self, time: Stamp) -> Option<Se3> {
        let after = self.readings.iter().position(|(stamp, _)| *stamp >= time);
        let second = after.unwrap_or(self.readings.len().checked_sub(1)?);
        let (t0, first) = *self.readings.get(second.checked_sub(1)?)?;
        let (t1, second) = self.readings[second];
        let (span, on) = (t1 - t0, time - t1);
        (span <= GAP_S && on <= ON_S).then(|| first.interpolate(&second, (time - t0) / span))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn::geometry::{So3, Vec3};

    fn stamp(ms: i64) -> Stamp {
        Stamp(ms * 1_000_000)
    }

    /// 0.5 m/s ahead.
    fn drive(wheels: &mut Wheels, ms: impl Iterator<Item = i64>) {
        let at = |ms| Se3::new(So3::identity(), Vec3::new(0.0005 * ms as f64, 0.0, 0.0));
        ms.for_each(|ms| wheels.add(stamp(ms), at(ms)));
    }

    #[test]
    fn motions_between_pictures_add_up() {
        let mut wheels = Wheels::default();
        assert!(wheels.motion_to(stamp(0)).is_none());
        let (mut sum, mut count) = (0.0, 0);
        for k in 1..40i64 {
            // Readings come at 50 Hz, up to 20 ms later than the picture.
            drive(&mut wheels, (33 * (k - 1)..33 * k).filter(|ms| ms % 20 == 0));
            if let Some(motion) = wheels.motion_to(stamp(33 * k)) {
                sum += motion.last_from_now.translation.x;
                count += 1;
                assert!((motion.sigma_m - 0.002 - 0.00165).abs() < 2e-4, "{motion:?}");
            }
        }
        assert!(
            (count, sum).0 >= 37 && (sum - 0.0165 * f64::from(count)).abs() < 1e-9,
            "{count} motions, {sum} m"
        );
        assert!(wheels.readings.len() < 10);
    }

    #[test]
    fn what_was_not_measured_is_not_known() {
        let mut wheels = Wheels::default();
        drive(&mut wheels, (0..=100).step_by(20));
        assert!(wheels.motion_to(stamp(90)).is_none(), "since which picture?");
        assert!(wheels.motion_to(stamp(140)).is_some(), "a reading that is late");
        assert!(wheels.motion_to(stamp(200)).is_none(), "none for too long");
        drive(&mut wheels, (400..=500).step_by(20));
        assert!(wheels.motion_to(stamp(380)).is_none(), "in a gap");
        assert!(wheels.motion_to(stamp(420)).is_none() && wheels.motion_to(stamp(460)).is_some());
        drive(&mut wheels, (0..=100).step_by(20));
        assert!(wheels.motion_to(stamp(90)).is_none(), "the time was set back");
    }
}
