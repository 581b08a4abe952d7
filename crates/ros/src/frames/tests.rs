//! The tree of frames on motions that are known.

use super::*;

fn turned(x: f64, y: f64, yaw: f64) -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0, 0.0, yaw)), Vec3::new(x, y, 0.0))
}

/// A robot that drives a curve; its camera looks ahead from 0.3 m before its origin, 0.2 m up.
fn robot(k: usize) -> Se3 {
    let s = k as f64 * 0.05;
    turned(s, 0.3 * s * s, 0.6 * s)
}

fn base_from_camera() -> Se3 {
    Se3::new(So3::identity(), Vec3::new(0.3, 0.0, 0.2)) * looking_ahead()
}

fn tracked(k: usize) -> Tracked {
    // The frame of tracking is that of its first camera.
    let camera = |k| robot(k) * base_from_camera();
    let pose = camera(0).inverse() * camera(k);
    Tracked {
        stamp: Stamp(k as i64 * 100_000_000),
        segment: 0,
        odom_from_camera: pose,
        world_from_camera: pose,
        scale: 1.0,
        metric: true,
        gravity_aligned: false,
        covariance: Matrix6::from_diagonal(&[1e-6, 4e-6, 9e-6, 1e-8, 1e-8, 1e-8].into()),
    }
}

fn near(a: &Se3, b: &Se3) -> bool {
    (a.matrix() - b.matrix()).norm() < 1e-9
}

#[test]
fn the_robot_drives_in_its_own_axes() {
    let mut tree = FrameTree::new(base_from_camera(), None);
    for k in 0..20 {
        let out = tree.step(&tracked(k));
        assert!(near(&out.odom_from_base, &robot(k)), "{k}: {:?}", out.odom_from_base);
        assert!(near(&out.map_from_odom.unwrap(), &Se3::identity()));
    }
}

#[test]
fn corrections_of_the_map_move_the_map_alone() {
    let mut tree = FrameTree::new(base_from_camera(), None);
    let correction = turned(0.4, -0.2, 0.1);
    for k in 0..20 {
        let mut t = tracked(k);
        if k >= 10 {
            // In the frame of the first camera, as tracking gives it.
            let about = base_from_camera().inverse() * correction * base_from_camera();
            t.world_from_camera = about * t.world_from_camera;
        }
        let out = tree.step(&t);
        assert!(near(&out.odom_from_base, &robot(k)));
        let expected = if k >= 10 { correction } else { Se3::identity() };
        assert!(near(&out.map_from_odom.unwrap(), &expected), "{k}");
    }
}

#[test]
fn odometry_never_jumps_when_it_begins_anew() {
    let mut tree = FrameTree::new(base_from_camera(), None);
    let mut before: Option<Se3> = None;
    for k in 0..20 {
        let mut t = tracked(k);
        if k >= 10 {
            t.segment = 1;
            t.odom_from_camera = turned(50.0, 3.0, 2.0) * t.odom_from_camera;
        }
        let out = tree.step(&t);
        if let Some(before) = before {
            let step = (before.inverse() * out.odom_from_base).translation.norm();
            assert!(step < 0.06, "{k}: {step} m");
        }
        assert_eq!(out.motion.is_none(), k == 0 || k == 10);
        // The map still has the robot where it is.
        assert!(near(&out.map_from_base().unwrap(), &robot(k)), "{k}");
        before = Some(out.odom_from_base);
    }
    assert_eq!(tree.restarts(), 1);
    // Nor when its clock was set back meanwhile.
    tree.break_off();
    let there = tree.step(&Tracked { segment: 1, ..tracked(3) });
    assert!(near(&there.odom_from_base, &before.unwrap()) && there.motion.is_none());
    assert!(near(&there.map_from_base().unwrap(), &robot(3)));
    assert_eq!(tree.restarts(), 2);
}

#[test]
fn a_change_of_the_unit_scales_motions_from_then_on() {
    let mut tree = FrameTree::new(looking_ahead(), None);
    let mut path = Vec::new();
    for k in 0..21 {
        let along = |metres: f64| Se3::new(So3::identity(), Vec3::new(0.0, 0.0, metres));
        // The odometry began in a unit of two metres; the map is metric from frame 10.
        let metric = k >= 10;
        let metres = 0.1 * k as f64;
        let out = tree.step(&Tracked {
            segment: 0,
            odom_from_camera: along(0.5 * metres),
            world_from_camera: along(if metric { metres } else { 0.5 * metres }),
            scale: if metric { 2.0 } else { 1.0 },
            metric,
            ..tracked(k)
        });
        path.push(out.odom_from_base.translation.x);
    }
    assert!((path[9] - 0.45).abs() < 1e-9 && (path[20] - path[9] - 1.1).abs() < 1e-9, "{path:?}");
}

#[test]
fn covariances_are_those_of_the_robot_about_the_axes_of_the_messages() {
    // The camera 0.3 m before the robot's origin; it knows its pose to 1, 2, 3 mm right, down, ahead, and 1 mrad about down.
    let arm = Se3::new(So3::identity(), Vec3::new(0.3, 0.0, 0.0)) * looking_ahead();
    let of_camera = Matrix6::from_diagonal(&[1e-6, 4e-6, 9e-6, 0.0, 1e-6, 0.0].into());
    // Of the robot: ahead, left (where it is farther from what turns it), up, and about up.
    let of_robot = [9e-6, 1e-6 + 0.09e-6, 4e-6, 0.0, 0.0, 1e-6];
    let mut tree = FrameTree::new(arm, None);
    let mut out = None;
    for k in 0..5 {
        // It drives left of where it began, 0.1 m each time.
        let robot = turned(0.0, 0.1 * k as f64, std::f64::consts::FRAC_PI_2);
        let pose = arm.inverse() * turned(0.0, 0.0, -std::f64::consts::FRAC_PI_2) * robot * arm;
        let tracked = Tracked {
            odom_from_camera: pose,
            world_from_camera: turned(0.0, 0.0, std::f64::consts::FRAC_PI_2) * pose,
            covariance: of_camera,
            ..tracked(k)
        };
        let now = tree.step(&tracked);
        if k == 0 {
            assert_eq!(now.odom_covariance, Matrix6::zeros());
            assert_eq!(now.motion_covariance, Matrix6::identity() * UNKNOWN);
        }
        out = Some(now);
    }
    let out = out.unwrap();
    let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
    for (i, expected) in of_robot.into_iter().enumerate() {
        let expected = expected + MAP_SIGMAS[i / 3].powi(2);
        assert!(near(out.map_covariance[(i, i)], expected), "{i}: {}", out.map_covariance);
    }
    // A motion lies between two poses. Each turns about its camera: the first one's was 0.2 m from where the motion ended.
    // And it is off by a share of its 0.1 m, along each axis.
    let off = OF_TRANSLATION.map(|share| (0.1 * share).powi(2));
    let motion = &out.motion_covariance;
    assert!(near(motion[(0, 0)], 18e-6 + off[0]) && near(motion[(5, 5)], 2e-6 + off[1]), "{motion}");
    assert!(near(motion[(1, 1)], (2.0 + 0.04 + 0.09) * 1e-6 + off[0]), "{motion}");
    // The noise of the last pose alone; and what each of four motions straight on is off by keeps its sign for a while.
    let odom = &out.odom_covariance;
    let rho = (-0.1f64 / CORRELATED_S).exp();
    let sum = 4.0 + 2.0 * (3.0 * rho + 2.0 * rho.powi(2) + rho.powi(3));
    assert!(near(odom[(5, 5)], 1e-6 + sum * off[1]), "{odom}");
    // Up: what it pitches by goes with the way since.
    assert!(odom[(2, 2)] > 4e-6 + sum * off[0] && odom[(2, 2)] < 4e-6 + 1.1 * sum * off[0], "{odom}");
    // After motion that was not observed nobody knows where it is in the odometry, but in the map.
    let lost = tree.step(&Tracked { segment: 1, covariance: of_camera, ..tracked(0) });
    assert!(lost.odom_covariance[(0, 0)] >= UNKNOWN && lost.map_covariance[(0, 0)] < 2e-4);
}

#[test]
fn a_tilted_start_is_made_level_and_alignment_keeps_the_heading() {
    // The robot's nose is 0.2 rad down at the start: up, as it sees it, leans backwards.
    let pitch = So3::exp(&Vec3::new(0.0, 0.2, 0.0));
    let up = pitch.inverse() * Vec3::new(0.0, 0.0, 9.81);
    let mut tree = FrameTree::new(looking_ahead(), Some(up));
    let mut t = tracked(0);
    (t.odom_from_camera, t.world_from_camera) = (Se3::identity(), Se3::identity());
    let out = tree.step(&t);
    assert!((out.odom_from_base.rotation.inverse() * pitch).angle() < 1e-9);
    // The map is aligned with gravity, with a heading of its own, 1 rad off.
    let level = Se3::new(So3::exp(&Vec3::new(0.0, 0.0, 1.0)) * pitch, Vec3::new(5.0, 6.0, 7.0));
    t.world_from_camera = level * looking_ahead();
    t.gravity_aligned = true;
    let out = tree.step(&t);
    let map_from_base = out.map_from_base().unwrap();
    assert!(near(&map_from_base, &Se3::new(pitch, Vec3::zeros())), "{map_from_base:?}");
    // Corrections after that stay in the map.
    t.world_from_camera.translation += Vec3::new(0.1, 0.0, 0.0);
    let moved = tree.step(&t).map_from_odom.unwrap().translation;
    assert!((moved.norm() - 0.1).abs() < 1e-9);
    assert!(
        FrameTree::new(looking_ahead(), Some(Vec3::new(0.0, 0.0, 0.3))).odom_from_base == Se3::identity()
    );
}

#[test]
fn a_robot_on_a_plane_has_no_height_and_no_tilt() {
    // The camera measures a slow roll and climb, as drift is; the wheels go straight on.
    let mut tree = FrameTree::new(looking_ahead(), None).on_a_plane();
    for k in 0..40 {
        let s = 0.05 * k as f64;
        let robot =
            Se3::new(So3::exp(&Vec3::new(0.05 * s, 0.05 * s, 0.2 * s)), Vec3::new(s, 0.1 * s * s, 0.04 * s));
        let pose = looking_ahead().inverse() * robot * looking_ahead();
        let out = tree.step(&Tracked { odom_from_camera: pose, world_from_camera: pose, ..tracked(k) });
        for pose in [out.odom_from_base, out.map_from_base().unwrap()] {
            let turned = pose.rotation.log();
            assert!(pose.translation.z.abs() < 1e-12 && turned.x.abs() < 1e-12 && turned.y.abs() < 1e-12);
            assert!((pose.translation - robot.translation).xy().norm() < 0.01 * s + 1e-9, "{k}: {pose:?}");
            assert!((turned.z - 0.2 * s).abs() < 0.01, "{k}: {turned:?}");
        }
        let motion = out.motion.unwrap_or_else(Se3::identity);
        assert!(motion.translation.z == 0.0 && out.odom_covariance[(2, 2)] == out.map_covariance[(3, 3)]);
        // What the camera measures is there for the watch.
        assert!(near(&tree.map_from_base().unwrap(), &robot));
    }
}

#[test]
fn in_a_saved_map_the_robot_has_no_place_until_it_is_recognised() {
    let mut tree = FrameTree::new(base_from_camera(), None);
    let map_from_world = turned(3.0, -1.0, 0.5) * base_from_camera();
    tree.in_saved_map(map_from_world, false);
    for k in 0..5 {
        let out = tree.step_elsewhere(&tracked(k));
        assert!(out.map_from_odom.is_none() && tree.map_from_base().is_none());
        assert!(near(&out.odom_from_base, &robot(k)), "the odometry is there");
    }
    let out = tree.step(&tracked(5));
    let expected = turned(3.0, -1.0, 0.5) * robot(5);
    assert!(near(&out.map_from_base().unwrap(), &expected) && near(&out.odom_from_base, &robot(5)));
}
