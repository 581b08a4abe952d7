//! Tracking with a motion that the wheels measured, on synthetic maps.

use crate::synthetic::{FEATURES, RATE_HZ, World, off, pose, sideways, stereo};
use crate::{KeyFrameRequest, MeasuredMotion, MotionSource, State, Tracked, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, Snapshot};
use cairn_geometry::Se3;

/// A walk in a world: the camera is where `truth` says, and the wheels say how it got there.
struct Walk {
    world: World,
    /// The same without anything to see.
    blank: World,
    atlas: Atlas,
    tracker: Tracker,
    truth: Se3,
    seconds: f64,
}

impl Walk {
    fn new(seed: u64) -> Self {
        let (world, mut blank) = (World::around(stereo(), seed), World::around(stereo(), seed));
        blank.points.clear();
        let (atlas, ids) = world.exact_map(&sideways(6, 0.2));
        let mut tracker = Tracker::new(world.camera, FEATURES, RATE_HZ, TrackerConfig::default());
        tracker.map_created(atlas.latest(), *ids.last().unwrap());
        let truth = atlas.latest().key_frame(*ids.last().unwrap()).unwrap().world_from_camera;
        Self { world, blank, atlas, tracker, truth, seconds: 2.5 }
    }

    fn snapshot(&self) -> &Snapshot {
        self.atlas.latest()
    }

    /// Goes to a pose; the wheels have measured `wheels`, with a standard deviation.
    fn go(&mut self, to: Se3, wheels: Option<Se3>, sigma: f64, is_blank: bool) -> Tracked {
        self.truth = to;
        self.seconds += 1.0 / RATE_HZ;
        let camera_from_body = self.world.camera.world_from_body(&Se3::identity(), true);
        let motion = wheels.map(|camera| MeasuredMotion {
            last_from_now: camera_from_body.inverse() * camera * camera_from_body,
            sigma_m: sigma,
            sigma_rad: sigma,
        });
        let world = if is_blank { &self.blank } else { &self.world };
        let view = world.see(&to, self.seconds);
        self.tracker.motion_measured(motion.as_ref());
        self.tracker.step(view.frame, &[], self.atlas.latest(), true, true)
    }

    /// As [`Walk::go`], with exact wheels.
    fn measured(&mut self, to: Se3, sigma: f64, is_blank: bool) -> Tracked {
        let wheels = self.truth.inverse() * to;
        self.go(to, Some(wheels), sigma, is_blank)
    }
}

fn far(tracked: &Tracked, truth: &Se3) -> f64 {
    let (m, rad) = off(&tracked.pose.expect("a pose").world_from_camera, truth);
    m.max(rad)
}

/// Two seconds of a plain wall, while the robot drives and turns: the same map goes on, and so does the odometry.
#[test]
fn wheels_carry_the_pose_past_a_plain_wall() {
    let mut walk = Walk::new(61);
    for k in 0..80 {
        // Away and back.
        let there = f64::from(if k < 40 { k } else { 80 - k });
        let (to, is_blank) = (pose(1.0 - 0.01 * there, 0.0, 0.02 * there), (20..60).contains(&k));
        let tracked = walk.measured(to, 0.001, is_blank);
        assert!(far(&tracked, &to) < 0.005, "frame {k}: {} off", far(&tracked, &to));
        assert_eq!(
            matches!(tracked.state, State::Coasting { .. }),
            is_blank,
            "frame {k}: {:?}",
            tracked.state
        );
        assert!(!matches!(tracked.request, Some(KeyFrameRequest::First { .. })), "frame {k}");
        let odometry = walk.tracker.odometry().unwrap();
        assert_eq!(odometry.segment, 0, "frame {k}");
        if (21..60).contains(&k) {
            assert_eq!(odometry.source, MotionSource::Measured, "frame {k}");
        }
    }
}

#[test]
fn a_pose_that_the_wheels_cannot_have_reached_is_not_taken() {
    let jump = pose(0.7, 0.0, 0.0);
    let mut walk = Walk::new(62);
    assert_eq!(walk.go(jump, None, 0.0, false).state, State::Tracking, "without wheels it is believed");
    let mut walk = Walk::new(62);
    let before = walk.truth;
    let tracked = walk.go(jump, Some(Se3::identity()), 0.001, false);
    assert!(matches!(tracked.state, State::Coasting { .. }), "{:?}", tracked.state);
    assert!(far(&tracked, &before) < 1e-9);
    // Wheels that are known to slip do not contradict it.
    let mut walk = Walk::new(62);
    let tracked = walk.go(jump, Some(Se3::identity()), 0.1, false);
    assert_eq!(tracked.state, State::Tracking);
    assert!(far(&tracked, &jump) < 2e-3);
}

/// What is seen turns by 0.03 rad a frame while the wheels stand still, as someone does who fills the view and walks by: too little for a
/// frame by itself, but not for all since the last key frame.
#[test]
fn tracking_does_not_creep_away_from_the_wheels() {
    for (sigma, is_held) in [(0.001, true), (0.05, false)] {
        let mut walk = Walk::new(64);
        // The first key frame that is asked for begins the motion that is counted.
        let (mut asked, mut turned) = (false, 0.0);
        while !asked {
            turned += 0.03;
            assert!(turned < 1.0);
            asked = walk.measured(pose(1.0, 0.0, turned), 0.001, false).request.is_some();
        }
        let stands = walk.truth;
        let mut farthest = 0.0;
        for k in 1..=8 {
            let seen = pose(1.0, 0.0, turned - 0.03 * f64::from(k));
            let tracked = walk.go(seen, Some(Se3::identity()), sigma, false);
            farthest = f64::max(farthest, far(&tracked, &stands));
        }
        assert_eq!(farthest < 0.1, is_held, "{sigma}: {farthest} off");
    }
}

#[test]
fn wheels_that_are_no_longer_certain_carry_nothing_and_any_place_may_be_found() {
    let mut walk = Walk::new(63);
    let mut lost = 0;
    for _ in 0..50 {
        let tracked = walk.measured(walk.truth, 0.05, true);
        lost += usize::from(matches!(tracked.state, State::Lost { .. }));
    }
    // A quarter of a metre after 25 steps; a fifth of a radian after 16.
    assert!((30..36).contains(&lost), "{lost} of 50");
    let elsewhere = pose(0.3, 0.1, 0.0);
    let tracked = walk.go(elsewhere, Some(Se3::identity()), 0.05, false);
    assert_eq!(tracked.state, State::Tracking, "relocalised");
    assert!(far(&tracked, &elsewhere) < 2e-3);
    assert!(walk.snapshot().key_frame_count() > 0);
}
