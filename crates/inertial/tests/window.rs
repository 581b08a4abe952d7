//! The window on a simulated walk: scale and velocity come from the readings.

mod common;

use cairn_geometry::{Manifold, Se3, So3, Vec3};
use cairn_inertial::{
    Bias, BiasPrior, FixedMask, Gravity, ImuBuffer, NavState, VioConfig, VioFrame, VioLink, VioWindow,
};
use cairn_sensor::{ImuSensor, Stamp};
use cairn_solve::{Observation, Pinhole, ransac::Rng};
use common::{Motion, NOISE, noisy, samples, some_bias, vector};

const CAMERA: Pinhole = Pinhole { fx: 400.0, fy: 400.0, cx: 320.0, cy: 240.0, baseline_fx: 0.0 };
const FROM: f64 = 0.4;

fn imu_from_camera() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(1.2, -1.1, 1.3)), Vec3::new(0.07, -0.02, 0.05))
}

fn truth(k: usize) -> NavState {
    Motion::state(FROM + 0.25 * k as f64, some_bias())
}

/// `n` key frames with points all around, one camera, half a pixel of noise; states as they are.
fn window(n: usize, seed: u64) -> VioWindow {
    let mut rng = Rng::new(seed);
    let frames: Vec<VioFrame> =
        (0..n).map(|k| VioFrame::of(&truth(k), &imu_from_camera(), FixedMask::Free)).collect();
    let (mut points, mut observations) = (Vec::new(), Vec::new());
    while points.len() < 250 {
        let p = vector(&mut rng, 1.0).normalize() * rng.range(3.0, 7.0);
        let mut seen = Vec::new();
        for (k, f) in frames.iter().enumerate() {
            let q = f.world_from_camera.inverse() * p;
            let (u, v) = (CAMERA.fx * q.x / q.z + CAMERA.cx, CAMERA.fy * q.y / q.z + CAMERA.cy);
            if q.z > 0.5 && (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v) {
                let pixel = [u + 0.5 * rng.normal(), v + 0.5 * rng.normal(), f64::NAN];
                seen.push(Observation { pose: k as u32, point: points.len() as u32, pixel, weight: 4.0 });
            }
        }
        if seen.len() >= 2 {
            observations.extend(seen);
            points.push(p);
        }
    }
    let (readings, _) = noisy(&mut rng, samples(FROM - 0.1, 0.25 * n as f64 + 0.2, 200.0), some_bias());
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise: NOISE, offset_s: 0.0 };
    let mut buffer = ImuBuffer::new(&sensor, 0.1);
    buffer.push(&readings);
    let at = |k: usize| Stamp::from_seconds(FROM + 0.25 * k as f64);
    let link = |k: usize| VioLink {
        from: k,
        to: k + 1,
        sum: buffer.preintegrate(Bias::default(), at(k), at(k + 1)).unwrap(),
    };
    VioWindow {
        camera: CAMERA,
        imu_from_camera: imu_from_camera(),
        gravity: Gravity::level(),
        frames,
        points,
        observations,
        links: (0..n - 1).map(link).collect(),
        bias_priors: Vec::new(),
    }
}

/// Away from the truth: everything a tenth too large about the first eye, no bias, velocities off.
fn disturb(w: &mut VioWindow, rng: &mut Rng) {
    let centre = w.frames[0].world_from_camera.translation;
    for f in w.frames.iter_mut().skip(1) {
        f.world_from_camera.translation = centre + (f.world_from_camera.translation - centre) * 1.1;
        f.world_from_camera.rotation = f.world_from_camera.rotation * So3::exp(&vector(rng, 0.01));
    }
    for f in &mut w.frames {
        f.velocity = f.velocity * 1.1 + vector(rng, 0.05);
        f.bias = Bias::default();
    }
    for p in &mut w.points {
        *p = centre + (*p - centre) * 1.1 + vector(rng, 0.05);
    }
}

fn thorough() -> VioConfig {
    VioConfig { iterations: 60, robust: true, tolerance: 1e-12 }
}

#[test]
fn scale_velocity_and_biases_come_from_the_readings() {
    let mut w = window(12, 1);
    w.frames[0].hold = FixedMask::Pose;
    disturb(&mut w, &mut Rng::new(2));
    let report = w.solve(&thorough(), || false);
    assert!(report.cost_after < 0.05 * report.cost_before, "{report:?}");
    let length = |of: &dyn Fn(usize) -> Vec3| (0..11).map(|k| (of(k + 1) - of(k)).norm()).sum::<f64>();
    let found = length(&|k| w.frames[k].world_from_camera.translation);
    let scale = found / length(&|k| (truth(k).world_from_imu * imu_from_camera()).translation);
    assert!((scale - 1.0).abs() < 0.01, "scale {scale}");
    for (k, f) in w.frames.iter().enumerate() {
        assert!((f.velocity - truth(k).velocity).norm() < 0.03, "{k}: {:?}", f.velocity);
        assert!((f.bias.gyro - some_bias().gyro).norm() < 2e-3, "{k}: {:?}", f.bias);
        assert!((f.bias.accel - some_bias().accel).norm() < 0.05, "{k}: {:?}", f.bias);
    }
    // Fifteen rows a link, of which velocities and biases take their part.
    let chi2 = w.link_chi2();
    let mean = chi2.iter().sum::<f64>() / chi2.len() as f64;
    assert!(mean < 15.0 && chi2.iter().all(|c| *c < 30.6), "{chi2:?}");
    let part = report.inliers as f64 / w.observations.len() as f64;
    assert!(part > 0.9, "{part}");
}

#[test]
fn the_gradient_is_that_of_the_cost() {
    // A solved window does not move when it is solved again, and does from anywhere near.
    let mut w = window(6, 3);
    w.frames[0].hold = FixedMask::Pose;
    w.solve(&thorough(), || false);
    let settled = w.clone();
    for seed in 0..3 {
        disturb(&mut w, &mut Rng::new(seed));
        w.solve(&thorough(), || false);
        for (a, b) in w.frames.iter().zip(&settled.frames) {
            assert!(a.world_from_camera.local(&b.world_from_camera).norm() < 1e-4, "{seed}");
            assert!((a.velocity - b.velocity).norm() < 1e-3, "{seed}");
        }
    }
}

/// What is known of a bias before holds it where the readings say nothing, and gives way where they do.
#[test]
fn a_known_bias_holds_as_far_as_it_is_known() {
    let solved = |sigma: f64| {
        let mut w = window(6, 3);
        w.frames[0].hold = FixedMask::Bias;
        let wrong = Bias { accel: some_bias().accel + Vec3::new(0.1, 0.0, 0.0), ..some_bias() };
        w.frames.iter_mut().for_each(|f| f.bias = wrong);
        w.bias_priors.push(BiasPrior { frame: 0, bias: wrong, sigmas: [sigma, sigma] });
        w.solve(&thorough(), || false);
        (w.frames[0].bias.accel - wrong.accel).norm()
    };
    let (held, free) = (solved(1e-5), solved(1.0));
    assert!(held < 1e-3 && (free - 0.1).abs() < 0.04, "{held} {free}");
}

/// A first key frame that keeps its place and heading is set upright by gravity.
#[test]
fn a_place_that_holds_may_still_tilt() {
    let mut w = window(12, 4);
    w.frames[0].hold = FixedMask::Place;
    // All of it is tilted by a degree, the sensor's biases are not known.
    let tilt = Se3::new(So3::exp(&Vec3::new(0.012, -0.012, 0.0)), Vec3::zeros());
    for f in &mut w.frames {
        f.world_from_camera = tilt * f.world_from_camera;
        f.bias = Bias::default();
    }
    w.points.iter_mut().for_each(|p| *p = tilt * *p);
    let (place, before) = (w.frames[0].world_from_camera.translation, w.frames[0].world_from_camera.rotation);
    w.solve(&thorough(), || false);
    assert!((w.frames[0].world_from_camera.translation - place).norm() < 1e-9);
    let up = |of: &So3| of.inverse() * Vec3::z();
    let right = (truth(0).world_from_imu * imu_from_camera()).rotation;
    let off = up(&w.frames[0].world_from_camera.rotation).angle(&up(&right));
    assert!(off < 2e-3 && up(&before).angle(&up(&right)) > 0.015, "{off} rad off the vertical");
    let turned = before.inverse() * w.frames[0].world_from_camera.rotation;
    assert!(turned.log().dot(&up(&right)).abs() < 1e-3, "the heading stays");
}

#[test]
fn nothing_breaks_on_empty_or_broken_windows() {
    let mut w = window(4, 6);
    w.points[0] = Vec3::new(0.0, 0.0, -1e6);
    w.observations.truncate(40);
    w.solve(&VioConfig::default(), || false);
    assert!(w.frames.iter().all(|f| f.world_from_camera.is_finite()));
    let mut empty = VioWindow { frames: vec![], points: vec![], observations: vec![], links: vec![], ..w };
    assert_eq!(empty.solve(&VioConfig::default(), || false).iterations, 0);
}
