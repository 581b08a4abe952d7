//! A moving camera whose rows are exposed one after the other, looking at known points.

use crate::shutter::{Moving, Shutter, in_camera};
use crate::synthetic::mono;
use cairn_adjust::locate;
use cairn_atlas::{Atlas, Change, Readout, Snapshot};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_random::Random;
use cairn_vision::{Frame, RectifiedCamera, triangulate_views};

const SIZE: [usize; 2] = [640, 480];
const ROWS: usize = SIZE[1];

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
    Moving { turning: Vec3::new(0.3, -0.5, 0.2), velocity: Vec3::new(0.2, 0.3, 1.2) }
}

#[test]
fn features_come_to_where_the_middle_row_saw_them() {
    let camera = mono();
    let points = points(&mut Random::new(1));
    for readout_s in [0.025, -0.025] {
        let (mut frame, ideal) = seen(&camera, &points, &walking(), readout_s);
        let before = farthest(&frame, &ideal);
        let shutter = Shutter::new(Some(readout_s), SIZE);
        shutter.correct(&mut frame, &camera, readout_s, &walking(), points.iter().copied());
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
    Shutter::new(Some(0.02), SIZE).correct(&mut frame, &camera, 0.02, &walking(), std::iter::empty());
    assert!(before > 1.5 && farthest(&frame, &ideal) < 0.1, "{before} {}", farthest(&frame, &ideal));
}

#[test]
fn a_frame_is_corrected_with_another_readout_time_later() {
    let camera = mono();
    let points = points(&mut Random::new(3));
    let (mut frame, ideal) = seen(&camera, &points, &walking(), -0.023);
    let shutter = Shutter::new(None, SIZE);
    let mut map = Atlas::new(Snapshot::new());
    assert_eq!(shutter.readout(map.latest()).seconds, 0.0);
    shutter.correct(&mut frame, &camera, 0.01, &walking(), points.iter().copied());
    assert!(farthest(&frame, &ideal) > 2.0);
    map.commit(vec![Change::Readout(Readout { seconds: -0.023, sigma_s: 1e-3 })]);
    let readout_s = shutter.readout(map.latest()).seconds;
    let later = |i: usize| frame.pixel_with(i, readout_s).map(|v| v as f32);
    frame.px = (0..points.len()).map(later).map(|[u, v, _]| [u, v]).collect();
    assert!(farthest(&frame, &ideal) < 0.05, "{}", farthest(&frame, &ideal));
}

/// A phone held upright: its camera, and what it sees, turned by a quarter.
#[test]
fn an_upright_image_is_read_along_its_width() {
    let points = points(&mut Random::new(6));
    let (mut frame, ideal) = seen(&mono(), &points, &walking(), 0.02);
    let quarter = |v: Vec3| Vec3::new(-v.y, v.x, v.z);
    let camera = mono();
    let upright = RectifiedCamera {
        fx: camera.fy,
        fy: camera.fx,
        cx: f64::from(SIZE[1] as u32) - 1.0 - camera.cy,
        cy: camera.cx,
        bounds: [0.0, 0.0, SIZE[1] as f64, SIZE[0] as f64],
        ..camera
    };
    let turn = |p: [f32; 2]| [(SIZE[1] - 1) as f32 - p[1], p[0]];
    frame.px = frame.px.iter().map(|p| turn(*p)).collect();
    frame.raw = frame.px.clone();
    let ideal: Vec<[f64; 2]> = ideal.iter().map(|p| [(SIZE[1] - 1) as f64 - p[1], p[0]]).collect();
    let moving = Moving { turning: quarter(walking().turning), velocity: quarter(walking().velocity) };
    assert!(farthest(&frame, &ideal) > 2.0);
    // Its first column is the last row of the sensor.
    let shutter = Shutter::new(None, [SIZE[1], SIZE[0]]);
    shutter.correct(&mut frame, &upright, -0.02, &moving, points.iter().map(|p| quarter(*p)));
    assert!(farthest(&frame, &ideal) < 0.05, "{}", farthest(&frame, &ideal));
}

#[test]
fn global_shutter_is_left_alone_whatever_the_map_estimates() {
    let camera = mono();
    let points = points(&mut Random::new(4));
    let (mut frame, ideal) = seen(&camera, &points, &walking(), 0.0);
    let shutter = Shutter::new(Some(0.0), SIZE);
    assert!(shutter.is_global());
    let mut map = Atlas::new(Snapshot::new());
    map.commit(vec![Change::Readout(Readout { seconds: 0.02, sigma_s: 1e-3 })]);
    let readout = shutter.readout(map.latest());
    assert_eq!(readout, Readout { seconds: 0.0, sigma_s: 0.0 });
    shutter.correct(&mut frame, &camera, readout.seconds, &walking(), points.iter().copied());
    assert!(farthest(&frame, &ideal) < 1e-3);
    assert_eq!(frame.rolling, None);
}

/// Poses of a turn on the spot at a walker's pace, and the camera's motion at each.
fn turn_on_the_spot() -> Vec<(Se3, Moving)> {
    let step = |k: usize| {
        let angle = 0.08 * k as f64;
        let rotation = So3::exp(&Vec3::new(0.0, angle, 0.0));
        let at = Vec3::new(0.25 * k as f64, 0.05 * k as f64, 0.1 * angle);
        let turning = Vec3::new(0.1, if k == 1 { 0.8 } else { 0.1 }, -0.1);
        (Se3::new(rotation, at), Moving { turning, velocity: Vec3::new(0.25, 0.1, 0.1) })
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
            let shutter = Shutter::new(Some(readout_s), SIZE);
            shutter.correct(&mut frame, &camera, readout_s, moving, here.into_iter());
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
