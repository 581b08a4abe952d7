//! Bundles with IMU factors on a simulated walk: scale, velocities and biases come from the readings.

use crate::common;

use cairn_geometry::{Manifold, Se3, So3, Vec3};
use cairn_inertial::{
    Bias, BiasPrior, Gravity, ImuBuffer, ImuFactors, ImuLink, MotionFreedom, NavState, Preintegrated,
    SpeedAndBias, ZeroVelocity,
};
use cairn_random::Random;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use cairn_solve::{Bundle, BundleConfig, Calibration, Freedom, Observation, Pinhole, Report};
use common::{HandMotion, NOISE, noisy, samples, some_bias, vector};

const CAMERA: Pinhole = Pinhole { fx: 400.0, fy: 400.0, cx: 320.0, cy: 240.0, baseline_fx: 0.0 };
const FROM: f64 = 0.4;

fn imu_from_camera() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(1.2, -1.1, 1.3)), Vec3::new(0.07, -0.02, 0.05))
}

struct Window {
    bundle: Bundle,
    imu: ImuFactors,
}

impl Window {
    fn solve(&mut self, config: &BundleConfig) -> Report {
        self.bundle.solve_with(&mut self.imu, config, || false)
    }

    fn fix_first_pose(&mut self) {
        self.bundle.freedom[0] = Freedom::Fixed;
    }
}

fn truth(k: usize) -> NavState {
    HandMotion::state(FROM + 0.25 * k as f64, some_bias())
}

/// `n` key frames with points all around, one camera, half a pixel of noise; states as they are.
fn window(n: usize, seed: u64) -> Window {
    let mut rng = Random::new(seed);
    let poses: Vec<Se3> = (0..n).map(|k| truth(k).world_from_imu * imu_from_camera()).collect();
    let motion =
        |k| SpeedAndBias { velocity: truth(k).velocity, bias: truth(k).bias, freedom: MotionFreedom::Free };
    let mut imu = ImuFactors::new(imu_from_camera(), Gravity::level(), (0..n).map(motion).collect());
    let (mut points, mut observations) = (Vec::new(), Vec::new());
    while points.len() < 250 {
        let p = vector(&mut rng, 1.0).normalize() * rng.uniform(3.0, 7.0);
        let mut seen = Vec::new();
        for (k, pose) in poses.iter().enumerate() {
            let q = pose.inverse() * p;
            let (u, v) = (CAMERA.fx * q.x / q.z + CAMERA.cx, CAMERA.fy * q.y / q.z + CAMERA.cy);
            if q.z > 0.5 && (0.0..640.0).contains(&u) && (0.0..480.0).contains(&v) {
                let pixel = [u + 0.5 * rng.standard_normal(), v + 0.5 * rng.standard_normal(), f64::NAN];
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
    let link = |k: usize| ImuLink {
        from: k,
        to: k + 1,
        sum: buffer.preintegrate(Bias::default(), at(k), at(k + 1)).unwrap(),
    };
    imu.links = (0..n - 1).map(link).collect();
    let freedom = vec![Freedom::Free; n];
    Window {
        bundle: Bundle {
            camera: CAMERA,
            own_cameras: Vec::new(),
            poses,
            freedom,
            points,
            observations,
            calibrations: vec![Calibration::default()],
        },
        imu,
    }
}

/// Away from the truth: everything a tenth too large about the first camera, no bias, wrong velocities.
fn disturb(w: &mut Window, rng: &mut Random) {
    let centre = w.bundle.poses[0].translation;
    for pose in w.bundle.poses.iter_mut().skip(1) {
        pose.translation = centre + (pose.translation - centre) * 1.1;
        pose.rotation = pose.rotation * So3::exp(&vector(rng, 0.01));
    }
    for m in &mut w.imu.motions {
        m.velocity = m.velocity * 1.1 + vector(rng, 0.05);
        m.bias = Bias::default();
    }
    for p in &mut w.bundle.points {
        *p = centre + (*p - centre) * 1.1 + vector(rng, 0.05);
    }
}

fn thorough() -> BundleConfig {
    BundleConfig { iterations: 60, robust: true, tolerance: 1e-12, first_damping: 1e-6 }
}

#[test]
fn imu_factors_determine_scale_velocity_and_biases() {
    let mut w = window(12, 1);
    w.fix_first_pose();
    disturb(&mut w, &mut Random::new(2));
    let report = w.solve(&thorough());
    assert!(report.cost_after < 0.05 * report.cost_before, "{report:?}");
    let length = |of: &dyn Fn(usize) -> Vec3| (0..11).map(|k| (of(k + 1) - of(k)).norm()).sum::<f64>();
    let found = length(&|k| w.bundle.poses[k].translation);
    let scale = found / length(&|k| (truth(k).world_from_imu * imu_from_camera()).translation);
    assert!((scale - 1.0).abs() < 0.01, "scale {scale}");
    for (k, f) in w.imu.motions.iter().enumerate() {
        assert!((f.velocity - truth(k).velocity).norm() < 0.03, "{k}: {:?}", f.velocity);
        assert!((f.bias.gyro - some_bias().gyro).norm() < 2e-3, "{k}: {:?}", f.bias);
        assert!((f.bias.accel - some_bias().accel).norm() < 0.05, "{k}: {:?}", f.bias);
    }
    // Fifteen rows a link, of which velocities and biases take their part.
    let chi2 = w.imu.link_chi2(&w.bundle.poses);
    let mean = chi2.iter().sum::<f64>() / chi2.len() as f64;
    assert!(mean < 15.0 && chi2.iter().all(|c| *c < 30.6), "{chi2:?}");
    let part = report.inliers as f64 / w.bundle.observations.len() as f64;
    assert!(part > 0.9, "{part}");
}

#[test]
fn solution_does_not_depend_on_the_start() {
    // From anywhere near, the same minimum is reached.
    let mut w = window(6, 3);
    w.fix_first_pose();
    w.solve(&thorough());
    let (poses, motions) = (w.bundle.poses.clone(), w.imu.motions.clone());
    for seed in 0..3 {
        disturb(&mut w, &mut Random::new(seed));
        w.solve(&thorough());
        assert!(w.bundle.poses.iter().zip(&poses).all(|(a, b)| a.local(b).norm() < 1e-4), "{seed}");
        let same = |(a, b): (&SpeedAndBias, &SpeedAndBias)| (a.velocity - b.velocity).norm() < 1e-3;
        assert!(w.imu.motions.iter().zip(&motions).all(same), "{seed}");
    }
}

/// A tight prior holds the bias, a loose one gives way to the readings.
#[test]
fn bias_prior_holds_as_far_as_its_sigma() {
    let solved = |sigma: f64| {
        let mut w = window(6, 3);
        w.fix_first_pose();
        w.imu.motions[0].freedom = MotionFreedom::Biases;
        let velocity = w.imu.motions[0].velocity;
        let wrong = Bias { accel: some_bias().accel + Vec3::new(0.1, 0.0, 0.0), ..some_bias() };
        w.imu.motions.iter_mut().for_each(|m| m.bias = wrong);
        w.imu.bias_priors.push(BiasPrior { frame: 0, bias: wrong, sigmas: [sigma, sigma] });
        w.solve(&thorough());
        assert_eq!(w.imu.motions[0].velocity, velocity);
        (w.imu.motions[0].bias.accel - wrong.accel).norm()
    };
    let (held, free) = (solved(1e-5), solved(1.0));
    assert!(held < 1e-3 && (free - 0.1).abs() < 0.04, "{held} {free}");
}

/// How far a camera that stands for ten seconds and sees nothing has gone, by readings with a bias; four key frames a second.
fn gone(still_sigma: Option<f64>) -> f64 {
    let n = 41;
    let pose = Se3::new(So3::exp(&Vec3::new(0.3, -0.2, 0.9)), Vec3::zeros());
    let force = pose.rotation.inverse() * -Gravity::level().vector();
    let exact = (0..=2100).map(|i| ImuSample::new(Stamp(i * 5_000_000), Vec3::zeros(), force)).collect();
    let bias = Bias { gyro: Vec3::new(1e-3, 0.0, -1e-3), accel: Vec3::new(0.05, -0.04, 0.03) };
    let (readings, _) = noisy(&mut Random::new(8), exact, bias);
    let motion =
        SpeedAndBias { velocity: Vec3::zeros(), bias: Bias::default(), freedom: MotionFreedom::Free };
    let mut w = window(2, 1);
    w.bundle.poses = vec![pose * imu_from_camera(); n];
    w.bundle.freedom = vec![Freedom::Free; n];
    (w.bundle.points, w.bundle.observations) = (vec![], vec![]);
    w.fix_first_pose();
    let part = |k: usize| readings[50 * k..=50 * (k + 1)].to_vec();
    let sum = |k: usize| Preintegrated::of(NOISE, Bias::default(), part(k));
    w.imu = ImuFactors::new(imu_from_camera(), Gravity::level(), vec![motion; n]);
    w.imu.links = (0..n - 1).map(|k| ImuLink { from: k, to: k + 1, sum: sum(k) }).collect();
    w.imu.bias_priors = vec![BiasPrior { frame: 0, bias: Bias::default(), sigmas: [0.002, 0.05] }];
    let still = |sigma: f64| (0..n).map(move |frame| ZeroVelocity { frame, sigma });
    w.imu.zero_velocities = still_sigma.into_iter().flat_map(still).collect();
    w.solve(&thorough());
    (w.bundle.poses[n - 1].translation - w.bundle.poses[0].translation).norm()
}

#[test]
fn zero_velocities_hold_a_camera_that_sees_nothing() {
    let (free, turning, standing) = (gone(None), gone(Some(0.15)), gone(Some(0.003)));
    assert!(free > 1.0, "the readings alone lead it {free} m away");
    assert!(turning < 0.3 && standing < 0.01, "{turning} m, {standing} m");
}

/// A first key frame that keeps its position and heading is set upright by gravity.
#[test]
fn gravity_levels_a_pose_that_may_tilt() {
    let mut w = window(12, 4);
    w.bundle.freedom[0] = Freedom::Tilt(Vec3::z());
    // All of it is tilted by a degree, the biases are unknown.
    let tilt = Se3::new(So3::exp(&Vec3::new(0.012, -0.012, 0.0)), Vec3::zeros());
    w.bundle.poses.iter_mut().for_each(|pose| *pose = tilt * *pose);
    w.imu.motions.iter_mut().for_each(|m| m.bias = Bias::default());
    w.bundle.points.iter_mut().for_each(|p| *p = tilt * *p);
    let before = w.bundle.poses[0];
    w.solve(&thorough());
    assert!((w.bundle.poses[0].translation - before.translation).norm() < 1e-9);
    let up = |of: &So3| of.inverse() * Vec3::z();
    let right = (truth(0).world_from_imu * imu_from_camera()).rotation;
    let off = up(&w.bundle.poses[0].rotation).angle(&up(&right));
    assert!(off < 2e-3 && up(&before.rotation).angle(&up(&right)) > 0.015, "{off} rad off the vertical");
    let turned = before.rotation.inverse() * w.bundle.poses[0].rotation;
    assert!(turned.log().dot(&up(&right)).abs() < 1e-3, "the heading stays");
}

#[test]
fn empty_and_broken_windows_do_no_harm() {
    let mut w = window(4, 6);
    w.bundle.points[0] = Vec3::new(0.0, 0.0, -1e6);
    w.bundle.observations.truncate(40);
    w.solve(&BundleConfig::default());
    assert!(w.bundle.poses.iter().all(|p| p.is_finite()));
    let mut empty = window(2, 1);
    (empty.bundle.poses, empty.bundle.freedom) = (vec![], vec![]);
    (empty.bundle.points, empty.bundle.observations) = (vec![], vec![]);
    (empty.imu.motions, empty.imu.links) = (vec![], vec![]);
    assert_eq!(empty.solve(&BundleConfig::default()).iterations, 0);
}

/// With IMU factors the disparity error of a stereo rig is estimated as without them.
#[test]
fn disparity_error_is_estimated_beside_imu_factors() {
    let mut w = window(12, 7);
    w.fix_first_pose();
    w.bundle.camera.baseline_fx = 60.0;
    for o in &mut w.bundle.observations {
        let q = w.bundle.poses[o.pose as usize].inverse() * w.bundle.points[o.point as usize];
        o.pixel[2] = o.pixel[0] - 60.0 / q.z - 0.3;
    }
    w.bundle.calibrations[0].sigma = 1.0;
    let mut held = Window { bundle: w.bundle.clone(), imu: w.imu.clone() };
    w.solve(&thorough());
    let offset = &w.bundle.calibrations[0];
    assert!((offset.value - 0.3).abs() < 0.02 && offset.information > 1e3, "{offset:?}");
    // Held, it stays and says where it would go.
    held.bundle.calibrations[0].held = true;
    held.solve(&thorough());
    held.solve(&BundleConfig { iterations: 1, ..thorough() });
    let offset = &held.bundle.calibrations[0];
    assert!(offset.value == 0.0 && (offset.pull - 0.3).abs() < 0.05, "{offset:?}");
}
