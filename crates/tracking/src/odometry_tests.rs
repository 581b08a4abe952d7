//! The odometry on synthetic maps: map corrections cause no jump in it, and unknown motion is reported.

use crate::odometry::OdometryFilter;
use crate::synthetic::{FEATURES, RATE_HZ, World, mono, off, pose, sideways, stereo};
use crate::{MotionSource, Odometry, State, Tracked, Tracker, TrackerConfig};
use cairn_atlas::{Atlas, Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, So3, Vec3};
use cairn_random::Random;
use cairn_vision::RectifiedCamera;

const STEP_S: f64 = 1.0 / RATE_HZ;

/// A walk through a synthetic world, frame by frame, with the current map.
struct Walk {
    world: World,
    atlas: Atlas,
    ids: Vec<KeyFrameId>,
    tracker: Tracker,
    at_s: f64,
    /// The last frame's true pose, odometry and pose in the map.
    last: Option<(Se3, Odometry, Se3)>,
}

/// The error of a frame's motion in `odom`, and how far the pose in the map jumped beyond the true motion.
struct Step {
    odometry: Odometry,
    off_m: f64,
    off_rad: f64,
    jump_m: f64,
}

impl Walk {
    fn new(camera: RectifiedCamera, seed: u64) -> Self {
        let world = World::around(camera, seed);
        let (atlas, ids) = world.exact_map(&sideways(8, 0.2));
        let mut tracker = Tracker::new(camera, FEATURES, RATE_HZ, TrackerConfig::default());
        tracker.map_created(atlas.latest(), *ids.last().unwrap());
        let at_s = 0.5 * (ids.len() - 1) as f64;
        Self { world, atlas, ids, tracker, at_s, last: None }
    }

    /// The walker's pose after a number of frames: back along the path at 0.6 m/s, turning slowly.
    fn truth(n: usize) -> Se3 {
        let k = n as f64;
        pose(1.4 - 0.03 * k, 0.004 * k, 0.004 * k)
    }

    fn track(&mut self, truth: &Se3) -> Tracked {
        self.at_s += STEP_S;
        let view = self.world.see(truth, self.at_s);
        self.tracker.step(view.frame, &[], self.atlas.latest(), true, false)
    }

    /// Tracks the next frame and compares its motion with the truth; a unit of the odometry has this many metres.
    fn go(&mut self, truth: Se3) -> Step {
        let tracked = self.track(&truth);
        let found = tracked.pose.unwrap_or_else(|| panic!("no pose: {:?}", tracked.state)).world_from_camera;
        let odometry = self.tracker.odometry().expect("a pose has an odometry");
        let again = odometry.world_from_odom.then(&odometry.odom_from_body);
        let (m, rad) = off(&again.se3, &found);
        assert!(m < 1e-9 && rad < 1e-9, "world_from_odom * odom_from_body is off by {m} m, {rad} rad");
        let before = self.last.replace((truth, odometry, found));
        let (off_m, off_rad, jump_m) = before.map_or((0.0, 0.0, 0.0), |(from, before, was)| {
            let motion = from.inverse() * truth;
            let in_odom = before.odom_from_body.se3.inverse() * odometry.odom_from_body.se3;
            let (m, rad) = off(&in_odom, &motion);
            (m, rad, off(&(was.inverse() * found), &motion).0)
        });
        Step { odometry, off_m, off_rad, jump_m }
    }

    /// Moves everything in the map, landmarks by `beside` more than key frames.
    fn move_map(&mut self, moved: &Se3, beside: &Vec3) {
        let snapshot = self.atlas.latest().clone();
        let key_frame = |k: &KeyFrame| Change::MoveKeyFrame(k.id, *moved * k.world_from_camera);
        let mut changes: Vec<Change> = snapshot.key_frames().map(key_frame).collect();
        changes
            .extend(snapshot.landmarks().map(|l| Change::MoveLandmark(l.id, *moved * l.position + *beside)));
        self.commit(changes);
    }

    fn commit(&mut self, changes: Vec<Change>) {
        assert_eq!(self.atlas.commit(changes).dropped, 0);
    }

    fn map(&self) -> MapId {
        MapId(self.ids[0])
    }
}

/// Twenty frames with a correction of the map in the middle: no motion in `odom` is off by a millimetre, while the
/// pose in the map jumps. `scale` is the factor by which the correction multiplies lengths.
fn no_step(camera: RectifiedCamera, scale: f64, correct: impl FnOnce(&mut Walk)) {
    let mut walk = Walk::new(camera, 41);
    let mut correct = Some(correct);
    let mut jump_m = 0.0_f64;
    for n in 1..=20 {
        if n == 10
            && let Some(correct) = correct.take()
        {
            correct(&mut walk);
        }
        let step = walk.go(Walk::truth(n));
        assert!(
            step.off_m < 1e-3 && step.off_rad < 1e-3,
            "frame {n}: {} m, {} rad",
            step.off_m,
            step.off_rad
        );
        assert_eq!((step.odometry.segment, step.odometry.source), (0, MotionSource::Map), "frame {n}");
        let expected = if n < 10 { 1.0 } else { scale };
        assert!((step.odometry.world_from_odom.sim3.scale - expected).abs() < 1e-9, "frame {n}");
        if n == 10 {
            jump_m = step.jump_m;
        }
    }
    assert!(jump_m > 0.02, "the pose in the map moved by {jump_m} m only: nothing is shown");
}

#[test]
fn a_loop_makes_no_step_in_odom() {
    // Loop closing moves key frames and landmarks near the camera by a metre and five degrees.
    no_step(stereo(), 1.0, |walk| {
        walk.move_map(
            &Se3::new(So3::exp(&Vec3::new(0.0, 0.087, 0.0)), Vec3::new(0.8, -0.1, 0.6)),
            &Vec3::zeros(),
        );
    });
}

#[test]
fn a_loop_that_moves_landmarks_otherwise_than_key_frames_makes_no_step_in_odom() {
    // Fused and adjusted with earlier landmarks, landmarks move relative to the key frames.
    for seed in [stereo(), mono()] {
        no_step(seed, 1.0, |walk| {
            let moved = Se3::new(So3::exp(&Vec3::new(0.0, 0.05, 0.02)), Vec3::new(0.5, 0.0, 0.3));
            walk.move_map(&moved, &Vec3::new(0.06, -0.03, 0.05));
        });
    }
}

#[test]
fn gravity_alignment_makes_no_step_in_odom() {
    no_step(stereo(), 1.0, |walk| {
        let align = Sim3::new(So3::exp(&Vec3::new(-1.4, 0.2, 0.3)), Vec3::zeros(), 1.0);
        walk.commit(vec![Change::AlignGravity(walk.map(), align)]);
    });
}

#[test]
fn gravity_and_scale_of_one_camera_make_no_step_in_odom() {
    no_step(mono(), 2.6, |walk| {
        let align = Sim3::new(So3::exp(&Vec3::new(-1.4, 0.2, 0.3)), Vec3::zeros(), 2.6);
        walk.commit(vec![Change::AlignGravity(walk.map(), align)]);
    });
}

#[test]
fn a_new_unit_of_the_map_makes_no_step_in_odom() {
    no_step(mono(), 0.3, |walk| walk.commit(vec![Change::Rescale(walk.map(), 0.3)]));
}

#[test]
fn a_merge_makes_no_step_in_odom() {
    // The camera is in the younger map, which has its own frame and unit.
    let mut walk = Walk::new(mono(), 42);
    let path = sideways(8, 0.2);
    let views = walk.world.walk(&path, walk.at_s + 1.0, 0.5);
    let own = Sim3::new(So3::exp(&Vec3::new(0.1, 0.7, 0.0)), Vec3::new(2.0, 0.3, -1.0), 1.8);
    let younger = walk.world.map(&mut walk.atlas, &views, &path, None, |_| own);
    walk.tracker = Tracker::new(walk.world.camera, FEATURES, RATE_HZ, TrackerConfig::default());
    walk.tracker.map_created(walk.atlas.latest(), *younger.last().unwrap());
    walk.at_s += 1.0 + 3.5;
    let mut jump_m = 0.0;
    let mut path_m = [0.0; 2];
    for n in 1..=20 {
        if n == 10 {
            let (from, into) = (MapId(younger[0]), walk.map());
            let parent = *walk.ids.last().unwrap();
            walk.commit(vec![Change::Merge { from, into, into_from: own.inverse(), parent }]);
        }
        let last = walk.last.map(|(_, odometry, _)| odometry.odom_from_body.se3);
        let step = walk.go(Walk::truth(n));
        let moved = |from: Se3| off(&from, &step.odometry.odom_from_body.se3).0;
        path_m[usize::from(n >= 10)] += last.map_or(0.0, moved);
        assert_eq!((step.odometry.segment, step.odometry.source), (0, MotionSource::Map), "frame {n}");
        if n == 10 {
            jump_m = step.jump_m;
            assert!((step.odometry.world_from_odom.sim3.scale - 1.0 / 1.8).abs() < 1e-6);
        }
    }
    // In the unit of the younger map, before and after.
    let metre = off(&Walk::truth(1), &Walk::truth(2)).0;
    let [before, after] = [path_m[0] / (8.0 * metre), path_m[1] / (11.0 * metre)];
    assert!((before - 1.8).abs() < 0.01 && (after - 1.8).abs() < 0.01, "{before} {after}");
    assert!(jump_m > 1.0, "{jump_m}");
}

#[test]
fn no_correction_makes_a_step_in_odom() {
    // Property: random corrections, each moving landmarks up to 5 cm relative to the key frames, at random frames.
    for seed in 0..6 {
        let mut random = Random::new(seed);
        let mut unit = move || random.uniform(-1.0, 1.0);
        let mut walk = Walk::new(if seed % 2 == 0 { stereo() } else { mono() }, 50 + seed);
        let mut vector = |length: f64| Vec3::new(unit(), unit(), unit()) * length;
        let (mut corrections, mut jumped) = (0, 0);
        for n in 1..=30 {
            let correct = n > 3 && vector(1.0).x > 0.4;
            if correct {
                let moved = Se3::new(So3::exp(&vector(0.2)), vector(2.0));
                walk.move_map(&moved, &vector(0.05));
                corrections += 1;
            }
            let step = walk.go(Walk::truth(n));
            assert!(
                step.off_m < 1e-3 && step.off_rad < 1e-3,
                "{seed} {n}: {} m {} rad",
                step.off_m,
                step.off_rad
            );
            assert_eq!((step.odometry.segment, step.odometry.source), (0, MotionSource::Map));
            jumped += usize::from(step.jump_m > 0.005);
        }
        assert!(corrections > 4 && jumped * 2 > corrections, "{jumped} of {corrections} corrections show");
    }
}

#[test]
fn a_short_loss_before_the_same_landmarks_keeps_the_segment() {
    let mut walk = Walk::new(stereo(), 43);
    let mut blank = World::around(stereo(), 43);
    blank.points.clear();
    (1..=5).for_each(|n| {
        walk.go(Walk::truth(n));
    });
    for n in 6..=10 {
        walk.at_s += STEP_S;
        let view = blank.see(&Walk::truth(n), walk.at_s);
        let tracked = walk.tracker.step(view.frame, &[], walk.atlas.latest(), true, false);
        assert!(matches!(tracked.state, State::Lost { .. }) && walk.tracker.odometry().is_none());
    }
    // The map is corrected meanwhile.
    walk.move_map(&Se3::new(So3::exp(&Vec3::new(0.0, 0.1, 0.0)), Vec3::new(1.0, 0.0, 0.0)), &Vec3::zeros());
    let step = walk.go(Walk::truth(11));
    assert_eq!((step.odometry.segment, step.odometry.source), (0, MotionSource::Map));
    assert!(step.off_m < 2e-3 && step.off_rad < 1e-3, "{} m over the gap", step.off_m);
}

#[test]
fn after_a_loss_elsewhere_a_new_segment_begins() {
    let mut walk = Walk::new(stereo(), 44);
    (1..=5).for_each(|n| {
        walk.go(Walk::truth(n));
    });
    let before = walk.last.unwrap().1;
    // The camera moves to where no landmark is shared, and is found again there in the map, after a loss.
    let far = World::around(stereo(), 45);
    for _ in 0..20 {
        walk.at_s += STEP_S;
        let view = far.see(&Se3::identity(), walk.at_s);
        assert!(walk.tracker.step(view.frame, &[], walk.atlas.latest(), true, false).pose.is_none());
    }
    let turned = sideways(4, 0.2).iter().map(|p| *p * pose(0.0, 0.0, 3.0)).collect::<Vec<_>>();
    let views = walk.world.walk(&turned, walk.at_s, 0.01);
    let parent = walk.ids.last().copied();
    walk.world.map(&mut walk.atlas, &views, &turned, parent, |_| Sim3::identity());
    walk.last = None;
    let step = walk.go(turned[1]);
    assert_eq!((step.odometry.segment, step.odometry.source), (1, MotionSource::None));
    assert_eq!(before.segment, 0);
    let moved = before.world_from_odom.inverse().sim3 * step.odometry.world_from_odom.sim3;
    assert!(moved.translation.norm() < 1e-9, "the relation to the map stays: {moved:?}");
    let step = walk.go(turned[1] * pose(0.01, 0.0, 0.0));
    assert!(step.odometry.segment == 1 && step.off_m < 1e-3);
}

#[test]
fn a_turn_by_rotation_only_holds_the_position_and_is_told() {
    let mut walk = Walk::new(mono(), 35);
    let mut sources = Vec::new();
    let place = |n: usize| pose(1.4, 0.0, 0.04 * n as f64);
    for n in 1..=50 {
        let step = walk.go(place(n));
        assert!(
            step.off_m < 0.01 && step.off_rad < 0.005,
            "frame {n}: {} m {} rad",
            step.off_m,
            step.off_rad
        );
        sources.push(step.odometry.source);
    }
    assert!(sources.contains(&MotionSource::RotationOnly), "{sources:?}");
    // Back into the map, a little beside where it was left: the pose in the map is corrected, the odometry continues.
    for n in (5..50).rev() {
        let step = walk.go(place(n));
        assert!(step.off_m < 0.01 && step.odometry.segment == 0, "frame {n}: {} m", step.off_m);
    }
    assert_eq!(walk.last.unwrap().1.source, MotionSource::Map);
}

#[test]
fn a_new_map_with_depth_goes_on_in_the_segment_and_one_without_begins_another() {
    for camera in [stereo(), mono()] {
        let mut walk = Walk::new(camera, 46);
        (1..=5).for_each(|n| {
            walk.go(Walk::truth(n));
        });
        let before = walk.tracker.odometry().unwrap();
        // The last frame becomes part of another map, two metres off.
        let path = [Walk::truth(4), Walk::truth(5)];
        let views = walk.world.walk(&path, walk.at_s - STEP_S, STEP_S);
        let beside = Sim3::new(So3::identity(), Vec3::new(2.0, 0.0, 0.0), 1.0);
        let ids = walk.world.map(&mut walk.atlas, &views, &path, None, |_| beside);
        walk.tracker.map_created(walk.atlas.latest(), ids[1]);
        let after = walk.tracker.odometry().unwrap();
        assert_eq!(after.odom_from_body, before.odom_from_body);
        assert_eq!(after.segment, u32::from(!camera.has_depth()));
        let moved = after.world_from_odom.sim3.translation - before.world_from_odom.sim3.translation;
        assert!((moved - Vec3::new(2.0, 0.0, 0.0)).norm() < 0.01, "{moved:?}");
        let step = walk.go(Walk::truth(6));
        assert!(step.off_m < 1e-3, "{} m", step.off_m);
    }
}

#[test]
fn without_a_map_there_is_no_odometry() {
    let world = World::around(stereo(), 47);
    let mut tracker = Tracker::new(world.camera, FEATURES, RATE_HZ, TrackerConfig::default());
    let view = world.see(&Se3::identity(), 0.0);
    tracker.step(view.frame, &[], &Snapshot::new(), true, true);
    assert!(tracker.odometry().is_none());
}

#[test]
fn last_stamp_is_that_of_the_last_frame_and_none_after_a_frame_without_a_pose() {
    let world = World::around(stereo(), 57);
    let (atlas, ids) = world.exact_map(&sideways(3, 0.2));
    let mut odometry = OdometryFilter::new(world.camera);
    assert_eq!(odometry.last_stamp(), None);
    odometry.map_created(atlas.latest(), ids[2]);
    assert_eq!(odometry.last_stamp(), atlas.latest().key_frame(ids[2]).map(|k| k.stamp));
    odometry.miss();
    assert_eq!(odometry.last_stamp(), None);
}
