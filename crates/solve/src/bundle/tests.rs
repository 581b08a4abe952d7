//! Tests of bundle adjustment on a small synthetic scene.

use super::*;
use cairn_geometry::So3;

/// Cameras on an arc around a cloud of points, stereo pixels without noise; the state is disturbed.
fn disturbed() -> (Bundle, Vec<Se3>) {
    let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };
    let mut bundle = Bundle {
        camera,
        own_cameras: Vec::new(),
        poses: vec![],
        freedom: vec![],
        points: vec![],
        observations: vec![],
        calibrations: vec![Calibration::default()],
    };
    let truth: Vec<Se3> = (0..6)
        .map(|i| {
            Se3::new(So3::exp(&Vec3::new(0.0, 0.05 * i as f64, 0.0)), Vec3::new(-0.3 * i as f64, 0.02, 0.0))
        })
        .collect();
    for (i, pose) in truth.iter().enumerate() {
        let e = 0.01 * i as f64;
        bundle.poses.push(*pose * Se3::new(So3::exp(&Vec3::new(e, -e, 0.5 * e)), Vec3::new(e, e, -e)));
        bundle.freedom.push(if i == 0 { Freedom::Fixed } else { Freedom::Free });
    }
    bundle.poses[0] = truth[0];
    for j in 0..80u32 {
        let a = j as f64;
        let p = Vec3::new((a * 0.9).sin() * 2.0, (a * 1.7).cos(), 5.0 + (a * 0.31).sin());
        for (i, pose) in truth.iter().enumerate() {
            let q = pose.inverse() * p;
            let u = camera.fx * q.x / q.z + camera.cx;
            let right = if j % 2 == 0 { u - camera.baseline_fx / q.z } else { f64::NAN };
            let pixel = [u, camera.fy * q.y / q.z + camera.cy, right];
            bundle.observations.push(Observation { pose: i as u32, point: j, pixel, weight: 1.0 });
        }
        bundle.points.push(p + Vec3::new(0.03, -0.02, 0.05) * (a * 2.3).sin());
    }
    (bundle, truth)
}

#[test]
fn recovers_the_true_poses() {
    let (mut bundle, truth) = disturbed();
    let config = BundleConfig { iterations: 20, tolerance: 1e-12, ..BundleConfig::default() };
    let report = bundle.solve(&config, || false);
    assert!(report.cost_after < 1e-8 * report.cost_before, "{report:?}");
    for (found, truth) in bundle.poses.iter().zip(&truth) {
        assert!(found.local(truth).norm() < 1e-5);
    }
}

#[test]
fn disparity_prior_counts_and_information_is_the_curvature() {
    let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-5 };
    let off = |before: f64, sigma: f64| {
        let (mut bundle, truth) = disturbed();
        bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
        // Two cameras a known distance apart determine scale, against which damping is small.
        (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
        bundle.calibrations[0] =
            Calibration { value: before, prior: before, sigma, ..Calibration::default() };
        bundle.solve(&config, || false);
        let cost = bundle.solve(&BundleConfig { iterations: 1, ..config }, || false).cost_after;
        (bundle.calibrations[0].value, bundle.calibrations[0].information, cost)
    };
    let (held, ..) = off(0.1, 1e-6);
    assert!((held - 0.1).abs() < 1e-3, "{held}");
    let (found, information, least) = off(0.1, 1e3);
    assert!((found - 0.3).abs() < 1e-3, "{found}");
    // Held off the best by d, all else free, it costs half the information times d squared.
    let d = 0.01;
    let (_, _, cost) = off(found + d, 0.0);
    let curvature = (cost - least) / (0.5 * d * d);
    assert!((information / curvature - 1.0).abs() < 0.05, "{information} against {curvature}");
}

#[test]
fn disparity_error_is_estimated() {
    let (mut bundle, truth) = disturbed();
    for o in &mut bundle.observations {
        o.pixel[2] -= 0.3;
    }
    // Hardly a prior: the data alone decides.
    bundle.calibrations[0].sigma = 1000.0;
    let config = BundleConfig { iterations: 40, tolerance: 1e-14, ..BundleConfig::default() };
    let report = bundle.solve(&config, || false);
    assert!((bundle.calibrations[0].value - 0.3).abs() < 1e-3, "{:?} {report:?}", bundle.calibrations[0]);
    assert!(bundle.poses.iter().zip(&truth).all(|(found, truth)| found.local(truth).norm() < 1e-3));
}

#[test]
fn an_error_along_slopes_is_estimated() {
    let (mut bundle, truth) = disturbed();
    // Each camera moved differently while its rows were read.
    let slope = |o: &Observation| {
        let share = (o.pixel[1] / 480.0 - 0.5) as f32;
        [share * 300.0 * (o.pose as f32).sin(), share * 200.0 * (1.7 * o.pose as f32).cos()]
    };
    let slopes: Vec<[f32; 2]> = bundle.observations.iter().map(slope).collect();
    for (o, [x, y]) in bundle.observations.iter_mut().zip(&slopes) {
        let off = [x, y, x].map(|s| 0.02 * f64::from(*s));
        (0..3).for_each(|i| o.pixel[i] -= off[i]);
    }
    bundle.calibrations[0] =
        Calibration { moves: Moves::Along(slopes), sigma: 1000.0, ..Calibration::default() };
    let config = BundleConfig { iterations: 40, tolerance: 1e-14, ..BundleConfig::default() };
    let report = bundle.solve(&config, || false);
    let found = bundle.calibrations[0].value;
    assert!((found - 0.02).abs() < 1e-4, "{found} {report:?}");
    assert!(bundle.poses.iter().zip(&truth).all(|(found, truth)| found.local(truth).norm() < 1e-3));
    assert!((0..bundle.observations.len()).all(|k| bundle.chi2_of(k) < 1e-3));
    let sigma = bundle.calibrations[0].information.sqrt().recip();
    assert!((1e-4..1e-2).contains(&sigma), "{sigma}");
}

/// A bundle with two numbers off: disparity by 0.3 px, and the readout time of a rolling shutter by 20 ms.
fn off_twice() -> (Bundle, Vec<Se3>) {
    let (mut bundle, truth) = disturbed();
    // Two cameras a known distance apart determine scale.
    (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
    let slope = |o: &Observation| {
        let share = (o.pixel[1] / 480.0 - 0.5) as f32;
        [share * 300.0 * (o.pose as f32).sin(), share * 200.0 * (1.7 * o.pose as f32).cos()]
    };
    let slopes: Vec<[f32; 2]> = bundle.observations.iter().map(slope).collect();
    for (o, [x, y]) in bundle.observations.iter_mut().zip(&slopes) {
        let off = [x, y, x].map(|s| 0.02 * f64::from(*s));
        (0..3).for_each(|i| o.pixel[i] -= off[i]);
        o.pixel[2] -= 0.3;
    }
    let of = |moves| Calibration { moves, sigma: 1000.0, ..Calibration::default() };
    bundle.calibrations = vec![of(Moves::Disparity), of(Moves::Along(slopes))];
    (bundle, truth)
}

#[test]
fn disparity_error_and_readout_time_are_estimated_together() {
    let (mut bundle, truth) = off_twice();
    let mut alone = bundle.clone();
    let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-5 };
    bundle.solve(&config, || false);
    let [disparity, readout] = [0, 1].map(|i| bundle.calibrations[i].value);
    assert!((disparity - 0.3).abs() < 1e-4 && (readout - 0.02).abs() < 1e-5, "{disparity} px, {readout} s");
    assert!(bundle.poses.iter().zip(&truth).all(|(found, truth)| found.local(truth).norm() < 1e-4));
    // Where one is not looked for, the other is wrong.
    alone.calibrations.pop();
    alone.solve(&config, || false);
    assert!((alone.calibrations[0].value - 0.3).abs() > 5e-4, "{}", alone.calibrations[0].value);
}

#[test]
fn information_on_one_of_two_numbers_is_the_curvature_with_the_other_free() {
    let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-9 };
    let (mut best, _) = off_twice();
    best.solve(&config, || false);
    let least = best.solve(&BundleConfig { iterations: 1, ..config }, || false).cost_after;
    for (this, d) in [(0, 0.01), (1, 1e-4)] {
        let mut off = best.clone();
        (off.calibrations[this].value, off.calibrations[this].sigma) =
            (best.calibrations[this].value + d, 0.0);
        let cost = off.solve(&config, || false).cost_after;
        let curvature = (cost - least) / (0.5 * d * d);
        let information = best.calibrations[this].information;
        assert!((information / curvature - 1.0).abs() < 0.05, "{this}: {information} against {curvature}");
    }
}

#[test]
fn a_number_that_is_held_leaves_the_other_where_it_would_be_without_it() {
    let config = BundleConfig { iterations: 20, robust: false, tolerance: 1e-14, first_damping: 1e-5 };
    let (bundle, _) = off_twice();
    let (mut without, mut held) = (bundle.clone(), bundle);
    without.calibrations.remove(0);
    held.calibrations[0].held = true;
    without.solve(&config, || false);
    held.solve(&config, || false);
    assert_eq!(held.calibrations[1].value, without.calibrations[0].value);
    assert_eq!(held.poses, without.poses);
    assert_eq!(held.calibrations[0].value, 0.0);
    // From there it says where both together would go.
    held.solve(&BundleConfig { iterations: 1, ..config }, || false);
    assert!((held.calibrations[0].pull - 0.3).abs() < 0.02, "{}", held.calibrations[0].pull);
}

#[test]
fn held_disparity_reports_its_pull_and_moves_nothing() {
    let config = BundleConfig { iterations: 40, robust: false, tolerance: 1e-14, first_damping: 1e-5 };
    let with = |sigma: f64, held: bool| {
        let (mut bundle, truth) = disturbed();
        bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
        (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
        (bundle.calibrations[0].sigma, bundle.calibrations[0].held) = (sigma, held);
        bundle.solve(&config, || false);
        // Once more from the solution: there the linear model gives the answer.
        bundle.solve(&config, || false);
        bundle
    };
    let (without, held, free) = (with(0.0, false), with(1e3, true), with(1e3, false));
    assert_eq!(held.calibrations[0].value, 0.0);
    assert!(held.poses.iter().zip(&without.poses).all(|(a, b)| a.local(b).norm() < 1e-9));
    assert!((held.calibrations[0].pull - 0.3).abs() < 0.01, "{}", held.calibrations[0].pull);
    assert!((held.calibrations[0].information / free.calibrations[0].information - 1.0).abs() < 0.1);
    assert!(free.calibrations[0].pull.abs() < 1e-4, "{}", free.calibrations[0].pull);
}

#[test]
fn interrupt_keeps_the_best_state() {
    let (mut bundle, _) = disturbed();
    let mut calls = 0;
    let report = bundle.solve(&BundleConfig::default(), || {
        calls += 1;
        calls > 2
    });
    assert_eq!(report.stop, Stop::Interrupted);
    assert!(report.cost_after < report.cost_before);
}

#[test]
fn point_behind_a_camera_is_left_out() {
    let (mut bundle, _) = disturbed();
    bundle.points[3] = Vec3::new(0.0, 0.0, -5.0);
    let report = bundle.solve(&BundleConfig::default(), || false);
    assert!(report.cost_after.is_finite() && report.cost_after < report.cost_before);
}

#[test]
fn tilting_pose_keeps_position_and_heading() {
    let (mut bundle, truth) = disturbed();
    let up = Vec3::y();
    // All but the first are right, so that it alone has to move; a tilt is taken back, the rest of its error is not.
    bundle.poses = truth.clone();
    bundle.freedom = vec![Freedom::Fixed; truth.len()];
    let wrong = Se3::new(So3::exp(&Vec3::new(0.02, 0.03, -0.01)), Vec3::new(0.01, 0.0, 0.0));
    bundle.poses[0] = wrong * truth[0];
    bundle.freedom[0] = Freedom::Tilt(up);
    let before = bundle.poses[0];
    let config = BundleConfig { iterations: 30, robust: false, tolerance: 1e-12, first_damping: 1e-5 };
    let report = bundle.solve(&config, || false);
    let turned = (bundle.poses[0].rotation * before.rotation.inverse()).log();
    assert!(report.cost_after < report.cost_before && turned.norm() > 0.01, "{turned:?}");
    assert_eq!(bundle.poses[0].translation, before.translation);
    assert!(turned.dot(&up).abs() < 1e-3 * turned.norm(), "{turned:?}");
}

#[test]
fn pose_covariance_is_the_inverse_of_the_curvature() {
    let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15, first_damping: 1e-9 };
    let (mut bundle, truth) = disturbed();
    (bundle.poses[5], bundle.freedom[5]) = (truth[5], Freedom::Fixed);
    bundle.solve(&config, || false);
    let covariance = bundle.pose_covariance(&mut NoFactors, 2, false).expect("a free pose");
    // Held off its best by d, everything else free, it costs half of d times the information times d.
    let d = SVector::<f64, 6>::from([0.002, -0.001, 0.003, 0.0005, -0.0004, 0.0003]);
    bundle.poses[2] = bundle.poses[2].retract(&d);
    bundle.freedom[2] = Freedom::Fixed;
    let cost = bundle.solve(&config, || false).cost_after;
    let expected = 0.5 * d.dot(&covariance.cholesky().expect("positive").solve(&d));
    assert!((cost / expected - 1.0).abs() < 0.05, "{cost} against {expected}");
    assert!(bundle.pose_covariance(&mut NoFactors, 0, false).is_none());
    assert!(bundle.pose_covariance(&mut NoFactors, 99, false).is_none());
}
