//! A moving camera whose rows are exposed one after the other, looking at known points.

use crate::shutter::{Moving, Shutter, in_camera};
use crate::synthetic::mono;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_solve::ransac::Rng;
use cairn_vision::{Frame, RectifiedCamera};

const ROWS: usize = 480;

/// The camera's pose `t` seconds after the middle row, seen from there.
fn moved(moving: &Moving, t: f64) -> Se3 {
    Se3::new(So3::exp(&(t * moving.turning)), t * moving.velocity)
}

/// Points in front of the camera, two depths beside each other.
fn points(rng: &mut Rng) -> Vec<Vec3> {
    let point = |_| {
        let x = rng.range(-0.4, 0.4);
        let z = if x < 0.0 { 2.5 } else { 6.0 };
        Vec3::new(x * z, rng.range(-0.35, 0.35) * z, z)
    };
    (0..400).map(point).collect()
}

/// The frame of these points, each seen at the time of its row, and where each would be at the middle row.
fn seen(
    camera: &RectifiedCamera,
    points: &[Vec3],
    moving: &Moving,
    readout_s: f64,
) -> (Frame, Vec<[f64; 2]>) {
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
    let points = points(&mut Rng::new(1));
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
    let points = points(&mut Rng::new(2));
    let turning = Moving { velocity: Vec3::zeros(), ..walking() };
    let (mut frame, ideal) = seen(&camera, &points, &turning, 0.02);
    let before = farthest(&frame, &ideal);
    Shutter::new(0.02, false, ROWS).correct(&mut frame, &camera, &walking(), std::iter::empty());
    assert!(before > 1.5 && farthest(&frame, &ideal) < 0.1, "{before} {}", farthest(&frame, &ideal));
}

#[test]
fn readout_time_and_its_direction_are_estimated() {
    let camera = mono();
    for readout_s in [0.018, -0.023] {
        let mut rng = Rng::new(3);
        let mut shutter = Shutter::new(0.0, true, ROWS);
        for _ in 0..60 {
            let mut around = |size: f64| Vec3::from_fn(|_, _| rng.range(-size, size));
            let moving = Moving { turning: around(0.6), velocity: around(1.0) };
            // The pose found is not quite the true one, and corners are found to half a pixel.
            let (off_m, off_rad) = (around(0.003), around(0.002));
            let points = points(&mut rng);
            let (mut frame, _) = seen(&camera, &points, &moving, readout_s);
            for px in &mut frame.px {
                px.iter_mut().for_each(|v| *v += rng.range(-0.5, 0.5) as f32);
            }
            let found = Se3::new(So3::exp(&off_rad), off_m);
            let matched: Vec<Vec3> = in_camera(&found, points.iter().copied()).collect();
            shutter.correct(&mut frame, &camera, &moving, matched.iter().copied());
            let matches = matched.iter().enumerate().map(|(i, p)| (i, *p, 1.0));
            shutter.learn(&frame, &camera, matches);
        }
        let [estimate, sigma] = shutter.readout_s();
        println!("readout {readout_s} s, estimated {estimate:.5} +- {sigma:.5}");
        assert!((estimate - readout_s).abs() < 1e-3 && sigma < 1e-3, "{estimate} {sigma}");
    }
}

#[test]
fn global_shutter_is_left_alone_and_nothing_is_learnt_unasked() {
    let camera = mono();
    let points = points(&mut Rng::new(4));
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
