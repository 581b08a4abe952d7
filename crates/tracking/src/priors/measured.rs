//! Dead reckoning: a motion that something else than the camera measured (the wheels of a robot) carries the pose from
//! frame to frame. It is the first guess and a prior of the pose; a pose that contradicts it is not taken (a chi-square
//! gate: Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section 5.4);
//! and where too little is seen, it is the pose, until its standard deviation is too great ([`crate::State::Coasting`]).

use super::{Correction, MotionPrior};
use crate::odometry::MotionSource;
use crate::reckoned::{Estimate, Reckoned, diagonal, tracked_covariance};
use crate::state::Last;
use cairn_adjust::MotionSince;
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_solve::PosePrior;

/// The motion of the body since the packet before, measured by other means than the camera and the IMU.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeasuredMotion {
    /// Pose of the body now, in its own frame at the packet before; metres.
    pub last_from_now: Se3,
    /// Standard deviation of its translation along each axis, metres.
    pub sigma_m: f64,
    /// Standard deviation of its rotation about each axis, radians.
    pub sigma_rad: f64,
}

/// Up to these standard deviations the pose is carried on without being tracked, metres and radians.
const COAST_SIGMA_M: f64 = 0.25;
const COAST_SIGMA_RAD: f64 = 0.2;

/// The motion since the last frame whose pose is kept.
#[derive(Clone, Debug, Default)]
pub(crate) struct DeadReckoning {
    /// What was measured for the frame that comes next, as a motion of the camera.
    next: Option<MeasuredMotion>,
    /// The last such motion, and all of it since the pose that is kept; `None` where a part was not measured.
    step: Option<Se3>,
    carried: Option<Se3>,
    /// Variances of the last such motion, m^2 and rad^2.
    step_variance: [f64; 2],
    /// Variances since the pose was last tracked, m^2 and rad^2.
    variance: [f64; 2],
    /// All of it since a key frame was asked for; `None` where a part was not measured.
    since_key_frame: Option<MotionSince>,
}

impl DeadReckoning {
    /// The motion up to the frame that comes next. One that is not finite, or without an uncertainty, counts as not measured.
    pub fn measured(&mut self, motion: Option<&MeasuredMotion>, camera_from_body: &Se3) {
        let sound = |m: &&MeasuredMotion| {
            m.last_from_now.is_finite() && [m.sigma_m, m.sigma_rad].iter().all(|s| s.is_finite() && *s >= 0.0)
        };
        self.next = motion.filter(sound).map(|m| MeasuredMotion {
            last_from_now: *camera_from_body * m.last_from_now * camera_from_body.inverse(),
            ..*m
        });
    }

    /// A frame has come.
    pub fn advance(&mut self) {
        let motion = self.next.take();
        self.step = motion.map(|m| m.last_from_now);
        self.carried = self.carried.zip(self.step).map(|(carried, step)| carried * step);
        if let Some(m) = motion {
            self.step_variance = [m.sigma_m.powi(2), m.sigma_rad.powi(2)];
            (0..2).for_each(|i| self.variance[i] += self.step_variance[i]);
        }
        self.since_key_frame = (self.since_key_frame.zip(motion))
            .map(|(since, m)| since.then(&m.last_from_now, [m.sigma_m.powi(2), m.sigma_rad.powi(2)]));
    }

    /// The pose of the last frame is kept: motions count from there on. It was tracked, or only carried there.
    pub fn restart(&mut self, is_tracked: bool) {
        self.carried = Some(Se3::identity());
        if is_tracked {
            self.variance = [0.0; 2];
        }
    }

    /// A key frame is asked for with the frame of this time. Returns the motion since the one before it.
    pub fn restart_at_key_frame(&mut self, stamp: Stamp) -> Option<MotionSince> {
        self.since_key_frame.replace(MotionSince::none(stamp))
    }

    /// The camera's motion since a key frame was asked for.
    pub fn since_key_frame(&self) -> Option<MotionSince> {
        self.since_key_frame
    }

    /// The camera's motion since the frame before, with the variances of its translation and rotation.
    pub fn uncertain_step(&self) -> Option<(Se3, [f64; 2])> {
        self.step.map(|step| (step, self.step_variance))
    }

    /// The pose now, from that of the last frame.
    pub(super) fn since(&self, last: Option<&Last>) -> Option<Reckoned> {
        self.pose(&last?.anchored.world_from_camera)
    }

    /// The pose now, from the one that was kept; `None` where a motion since then was not measured.
    pub fn pose(&self, kept: &Se3) -> Option<Reckoned> {
        self.step?;
        let covariance = diagonal(self.variance) + tracked_covariance();
        let limit = [COAST_SIGMA_M, COAST_SIGMA_RAD];
        Some(Reckoned { world_from_camera: *kept * self.carried?, covariance, limit })
    }
}

impl MotionPrior for DeadReckoning {
    fn predict(&self, last: Option<&Last>, _: Stamp) -> Option<Se3> {
        Some(self.since(last)?.world_from_camera)
    }

    fn carry(&self, last: Option<&Last>, _: Stamp) -> Option<Estimate> {
        self.since(last)?.carry()
    }

    fn prior(&self, last: Option<&Last>, _: Stamp) -> Option<PosePrior> {
        Some(self.since(last).filter(Reckoned::may_coast)?.prior())
    }

    fn agrees(&self, last: Option<&Last>, _: Stamp, world_from_camera: &Se3) -> bool {
        self.since(last).is_none_or(|reckoned| reckoned.agrees(world_from_camera))
    }

    fn relative(&self) -> Option<(Se3, MotionSource)> {
        self.step.map(|step| (step, MotionSource::Measured))
    }

    fn correct(&mut self, _: &Correction) {
        self.restart(true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reckoned::TRACKED_SIGMA_M;
    use cairn_geometry::{Manifold, So3, Vec3};

    fn motion(x: f64, yaw: f64) -> MeasuredMotion {
        let last_from_now = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)), Vec3::new(x, 0.0, 0.0));
        MeasuredMotion { last_from_now, sigma_m: 0.01, sigma_rad: 0.01 }
    }

    /// Steps of the body are laid onto the pose of a camera that is mounted elsewhere and looks elsewhere.
    #[test]
    fn the_camera_goes_where_the_body_takes_it() {
        let body_from_camera = Se3::new(So3::exp(&Vec3::new(-1.2, 0.4, 0.7)), Vec3::new(0.1, -0.2, 0.8));
        let mut reckoning = DeadReckoning::default();
        reckoning.restart(true);
        let mut body = Se3::exp(&[1.0, 2.0, 0.3, 0.1, -0.2, 0.9].into());
        let kept = body * body_from_camera;
        for k in 0..25 {
            let m = motion(0.04, 0.02 * f64::from(k % 5));
            reckoning.measured(Some(&m), &body_from_camera.inverse());
            reckoning.advance();
            body = body * m.last_from_now;
        }
        let reckoned = reckoning.pose(&kept).unwrap();
        let off = reckoned.world_from_camera.local(&(body * body_from_camera));
        assert!(off.norm() < 1e-12, "{off}");
        // 25 steps of one centimetre each are five together.
        assert!((reckoned.sigma()[0] - (0.05f64.powi(2) + TRACKED_SIGMA_M.powi(2)).sqrt()).abs() < 1e-12);
        reckoning.restart(false);
        assert_eq!(reckoning.pose(&kept).unwrap().world_from_camera, kept);
        assert_eq!(reckoning.pose(&kept).unwrap().covariance, reckoned.covariance, "carried, not seen");
        reckoning.restart(true);
        assert!(reckoning.pose(&kept).unwrap().sigma()[0] < 0.02);
    }

    #[test]
    fn a_gap_in_the_measurements_ends_it_until_a_pose_is_known() {
        let mut reckoning = DeadReckoning::default();
        let kept = Se3::identity();
        let go = |reckoning: &mut DeadReckoning, m: Option<MeasuredMotion>| {
            reckoning.measured(m.as_ref(), &Se3::identity());
            reckoning.advance();
            reckoning.pose(&kept).is_some()
        };
        assert!(!go(&mut reckoning, Some(motion(0.1, 0.0))), "no pose yet");
        reckoning.restart(true);
        assert!(go(&mut reckoning, Some(motion(0.1, 0.0))));
        let nan = MeasuredMotion { sigma_rad: f64::NAN, ..motion(0.1, 0.0) };
        assert!(!go(&mut reckoning, Some(nan)));
        assert!(!go(&mut reckoning, Some(motion(0.1, 0.0))));
        reckoning.restart(true);
        assert!(!go(&mut reckoning, None));
        reckoning.restart(true);
        assert!(go(&mut reckoning, Some(motion(0.1, 0.0))));
    }

    #[test]
    fn uncertain_step_is_the_last_motion_with_its_own_variances() {
        let mut reckoning = DeadReckoning::default();
        reckoning.restart(true);
        for (x, sigma_m) in [(0.1, 0.02), (0.3, 0.05)] {
            let measured = MeasuredMotion { sigma_m, ..motion(x, 0.2) };
            reckoning.measured(Some(&measured), &Se3::identity());
            reckoning.advance();
            let (step, variance) = reckoning.uncertain_step().expect("measured");
            assert_eq!(step, measured.last_from_now);
            assert_eq!(variance, [sigma_m * sigma_m, 1e-4]);
        }
        reckoning.advance();
        assert_eq!(reckoning.uncertain_step(), None, "nothing was measured");
    }

    #[test]
    fn the_gate_widens_as_the_pose_becomes_uncertain_and_coasting_ends() {
        let mut reckoning = DeadReckoning::default();
        reckoning.restart(true);
        let mut last = None;
        for k in 0..700 {
            reckoning.measured(Some(&motion(0.0, 0.0)), &Se3::identity());
            reckoning.advance();
            let reckoned = reckoning.pose(&Se3::identity()).unwrap();
            let far = Se3::new(So3::identity(), Vec3::new(0.3, 0.0, 0.0));
            if k == 0 {
                assert!(!reckoned.agrees(&far) && reckoned.agrees(&Se3::identity()) && reckoned.may_coast());
            }
            last = Some((reckoned.agrees(&far), reckoned.may_coast()));
        }
        assert_eq!(last, Some((true, false)));
    }
}
