//! A moving camera whose rows are exposed one after the other, looking at known points.

use crate::shutter::{Moving, Shutter, in_camera};
use crate::synthetic::mono;
use cairn_adjust::locate;
use cairn_atlas::Snapshot;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_vision::{Frame, RectifiedCamera, triangulate_views};

const ROWS: usize = 480;

/// A frame, and where each of its points would be at the middle row.
type Seen = (Frame, Vec<[f64; 2]>);

/// The camera's pose `t` seconds after the middle row, seen from there.
fn moved(moving: &Moving, t: f64) -> Se3 {
    Se3::new(So3::exp(&(t * moving.turning)), t * moving.velocity)
}

/// Points in front of the camera, two depths beside each other; none so near to the border between them that it is seen on the
/// other side while the rows are read, and corrected by that depth.
fn points(rng: &mut Random) -> Vec<Vec3> {
    let point = |_| {
        let (side, z) = if rng.chance(0.5) { (-1.0, 2.5) } else { (1.0, 6.0) };
        let x = side * rng.uniform(0.01, 0.4);
        Vec3::new(x * z, rng.uniform(-0.35, 0.35) * z, z)
    };
    (0..400).map(point).collect()
}

/// The frame of these points, each seen at the time of its row, and where each would be at the middle row.
fn seen(camera: &RectifiedCamera, points: &[Vec3], moving: &Moving, readout_s: f64) -> Seen {
    let mut frame = Frame::default();
    let mut ideal = Vec::new();
    for p in points {
        let [u, v, _] = camera.project(p).unwrap();
        let mut at = [u, v];
        for _ in 0..5 {
            let t = readout_s * ((at[1] + 0.5) / ROWS as f64 - 0.5);
            let [u, v, _] = camera.project(&(moved(moving, t).inverse() * *p)).unwrap();
            at = [u, v];
        }
        let px = at.map(|a| a as f32);
        frame.px.push(px);
        frame.raw.push(px);
        ideal.push([u, v]);
    }
    frame.octave = vec![0; points.len()];
    frame.right_x = vec![f32::NAN; points.len()];
    (frame, ideal)
}

fn farthest(frame: &Frame, ideal: &[[f64; 2]]) -> f64 {
    let off = |(px, ideal): (&[f32; 2], &[f64; 2])| {
        (f64::from(px[0]) - ideal[0]).hypot(f64::from(px[1]) - ideal[1])
    };
    frame.px.iter().zip(ideal).map(off).fold(0.0, f64::max)
}

fn walking() -> Moving {
    Moving { turning: Vec3::new(0.3, -0.5, 0.2), velocity: Vec3::new(0.2, 0.3, 1.2), velocity_sigma: 0.0 }
}

#[test]
fn features_come_to_where_the_middle_row_saw_them() {
    let camera = mono();
    let points = points(&mut Random::new(1));
    for readout_s in [0.025, -0.025] {
        let (mut frame, ideal) = seen(&camera, &points, &walking(), readout_s);
        let before = farthest(&frame, &ideal);
        let mut shutter = Shutter::new(readout_s, false, ROWS);
        shutter.correct(&mut frame, &camera, &walking(), points.iter().copied());
        let after = farthest(&frame, &ideal);
        println!("readout {readout_s} s: {before:.2} px off, corrected {after:.2}");
        assert!(before > 2.0 && after < 0.05, "{before} {after}");
    }
}

#[test]
fn rotation_is_corrected_where_no_depth_is_known() {
    let camera = mono();
    let points = points(&mut Random::new(2));
    let turning = Moving { velocity: Vec3::zeros(), ..walking() };
    let (mut frame, ideal) = seen(&camera, &points, &turning, 0.02);
    let before = farthest(&frame, &ideal);
    Shutter::new(0.02, false, ROWS).correct(&mut frame, &camera, &walking(), std::iter::empty());
    assert!(before > 1.5 && farthest(&frame, &ideal) < 0.1, "{before} {}", farthest(&frame, &ideal));
}

/// The readout time that is estimated from 60 frames, and its standard deviation; `told` is the velocity that the shutter is told
/// of a true one, and its standard deviation.
fn estimated(readout_s: f64, told: impl Fn(Vec3) -> (Vec3, f64)) -> [f64; 2] {
    let camera = mono();
    {
        let mut rng = Random::new(3);
        let mut shutter = Shutter::new(0.0, true, ROWS);
        for _ in 0..60 {
            let mut around = |size: f64| Vec3::from_fn(|_, _| rng.uniform(-size, size));
            let moving = Moving { turning: around(0.6), velocity: around(1.0), velocity_sigma: 0.0 };
            // The pose found is not quite the true one, and corners are found to half a pixel.
            let (off_m, off_rad) = (around(0.003), around(0.002));
            let points = points(&mut rng);
            let (mut frame, _) = seen(&camera, &points, &moving, readout_s);
            for px in &mut frame.px {
                px.iter_mut().for_each(|v| *v += rng.uniform(-0.5, 0.5) as f32);
            }
            let found = Se3::new(So3::exp(&off_rad), off_m);
            let matched: Vec<Vec3> = in_camera(&found, points.iter().copied()).collect();
            let (velocity, velocity_sigma) = told(moving.velocity);
            let moving = Moving { velocity, velocity_sigma, ..moving };
            shutter.correct(&mut frame, &camera, &moving, matched.iter().copied());
            let matches = matched.iter().enumerate().map(|(i, p)| (i, *p, 1.0));
            shutter.learn(&frame, &camera, matches);
        }
        shutter.readout_s()
    }
}

#[test]
fn readout_time_and_its_direction_are_estimated() {
    for readout_s in [0.018, -0.023] {
        let [estimate, sigma] = estimated(readout_s, |velocity| (velocity, 0.0));
        println!("readout {readout_s} s, estimated {estimate:.5} +- {sigma:.5}");
        assert!((estimate - readout_s).abs() < 1e-3 && sigma < 1e-3, "{estimate} {sigma}");
    }
}

#[test]
fn a_velocity_that_nobody_knows_does_not_turn_the_readout_time_round() {
    // As half a stride ago: what goes up is told to go down.
    let opposite = |velocity: Vec3| -velocity;
    let [believed, _] = estimated(0.02, |velocity| (opposite(velocity), 0.0));
    let [estimate, sigma] = estimated(0.02, |velocity| (opposite(velocity), f64::INFINITY));
    println!("estimated {estimate:.5} +- {sigma:.5}, {believed:.5} where the velocity is believed");
    assert!(believed < 0.016, "{believed}");
    assert!((estimate - 0.02).abs() < 1e-3 && sigma < 1e-3, "{estimate} {sigma}");
}

#[test]
fn global_shutter_is_left_alone_and_nothing_is_learnt_unasked() {
    let camera = mono();
    let points = points(&mut Random::new(4));
    let (mut frame, ideal) = seen(&camera, &points, &walking(), 0.0);
    let mut shutter = Shutter::new(0.0, false, ROWS);
    assert!(shutter.is_global());
    shutter.correct(&mut frame, &camera, &walking(), points.iter().copied());
    shutter.learn(&frame, &camera, points.iter().enumerate().map(|(i, p)| (i, *p, 1.0)));
    assert!(farthest(&frame, &ideal) < 1e-3);
    assert_eq!(shutter.readout_s(), [0.0, 0.0]);
    // Without motion or matches there is nothing to learn, and the uncertainty says so.
    let mut unknown = Shutter::new(0.0, true, ROWS);
    unknown.correct(&mut frame, &camera, &Moving::default(), points.iter().copied());
    unknown.learn(&frame, &camera, points.iter().enumerate().map(|(i, p)| (i, *p, 1.0)));
    assert_eq!(unknown.readout_s(), [0.0, 0.02]);
}

/// Poses of a turn on the spot at a walker's pace, and the camera's motion at each.
fn turn_on_the_spot() -> Vec<(Se3, Moving)> {
    let step = |k: usize| {
        let angle = 0.08 * k as f64;
        let rotation = So3::exp(&Vec3::new(0.0, angle, 0.0));
        let at = Vec3::new(0.25 * k as f64, 0.05 * k as f64, 0.1 * angle);
        let turning = Vec3::new(0.1, if k == 1 { 0.8 } else { 0.1 }, -0.1);
        (Se3::new(rotation, at), Moving { turning, velocity: Vec3::new(0.25, 0.1, 0.1), velocity_sigma: 0.0 })
    };
    (0..3).map(step).collect()
}

/// What the stages make of exact projections in a turn: the largest residual at the true poses in pixels, of landmarks that
/// are triangulated from all frames their distance from the truth in metres, and of the pose that is located in the turning
/// frame its errors in metres and radians.
fn stages(correct: bool) -> [f64; 4] {
    let (camera, readout_s) = (mono(), 0.025);
    let points = points(&mut Random::new(5));
    let poses = turn_on_the_spot();
    let seen_by_all = |p: &&Vec3| {
        let inside = |(pose, _): &(Se3, Moving)| {
            camera.project(&(pose.inverse() * **p)).is_some_and(|[u, v, _]| camera.contains(u, v))
        };
        poses.iter().all(inside)
    };
    let points: Vec<Vec3> = points.iter().filter(seen_by_all).copied().collect();
    assert!(points.len() > 100, "{}", points.len());
    let frames = poses.iter().map(|(pose, moving)| {
        let here: Vec<Vec3> = in_camera(pose, points.iter().copied()).collect();
        let (mut frame, ideal) = seen(&camera, &here, moving, readout_s);
        if correct {
            Shutter::new(readout_s, false, ROWS).correct(&mut frame, &camera, moving, here.into_iter());
        }
        (frame, ideal)
    });
    let frames: Vec<Seen> = frames.collect();
    let residual = frames.iter().map(|(frame, ideal)| farthest(frame, ideal)).fold(0.0, f64::max);
    let off = |i: usize| {
        let ray = |((pose, _), (frame, _)): (&(Se3, Moving), &Seen)| {
            (pose.inverse(), camera.unproject(frame.px[i], 1.0))
        };
        let views: Vec<(Se3, Vec3)> = poses.iter().zip(&frames).map(ray).collect();
        (triangulate_views(&views).unwrap() - points[i]).norm()
    };
    let landmark_m = (0..points.len()).map(off).fold(0.0, f64::max);
    let matches: Vec<(usize, Vec3)> = points.iter().copied().enumerate().collect();
    let (frame, truth) = (&frames[1].0, poses[1].0);
    let none = vec![None; points.len()];
    let found = locate(&Snapshot::new(), &camera, frame, &truth, &none, &matches, None);
    let error = truth.inverse() * found.world_from_camera;
    [residual, landmark_m, error.translation.norm(), error.rotation.log().norm()]
}

#[test]
fn residuals_landmarks_and_poses_of_a_turn_are_those_of_a_global_shutter() {
    let [residual, landmark_m, position_m, angle_rad] = stages(true);
    let before = stages(false);
    println!(
        "corrected {residual:.3} px, {landmark_m:.4} m, {position_m:.5} m, {angle_rad:.6} rad; before {before:.4?}"
    );
    // What is left of the residuals is at the edge between two depths, which share a cell of the grid.
    assert!(residual < 0.25 && landmark_m < 0.01 && position_m < 1e-3 && angle_rad < 2e-4);
    assert!(before[0] > 3.0 && before[1] > 5.0 * landmark_m && before[2] > 10.0 * position_m);
}
