//! Preintegration: exact motions, numeric Jacobians, consistency over many noisy runs.

use crate::common;

use cairn_geometry::{Manifold, So3, Vec3};
use cairn_inertial::{Bias, Gravity, NavState, Preintegrated};
use cairn_random::Random;
use cairn_sensor::ImuNoise;
use common::{HandMotion, NOISE, noisy, samples, some_bias};
use nalgebra::{SMatrix, SVector, Vector2};

#[test]
fn exact_readings_predict_the_motion() {
    let gravity = Gravity::level().vector();
    for rate in [100.0, 200.0, 400.0] {
        let sum = Preintegrated::of(NOISE, Bias::default(), samples(0.3, 2.0, rate));
        let found = sum.predict(&HandMotion::state(0.3, Bias::default()), &gravity);
        let off = HandMotion::state(2.3, Bias::default()).local(&found);
        // The midpoint rule's error falls with the square of the step.
        let bound = 1.5e-3 * (200.0f64 / rate).powi(2);
        assert!(
            off.fixed_rows::<3>(0).norm() < bound && off.fixed_rows::<3>(3).norm() < bound,
            "{rate}: {off}"
        );
        assert!(off.fixed_rows::<3>(6).norm() < bound, "{rate}: {off}");
    }
}

#[test]
fn a_bias_is_taken_off_and_a_near_one_corrected_to_first_order() {
    let bias = some_bias();
    let mut biased = samples(0.0, 0.5, 200.0);
    for s in &mut biased {
        s.gyro += bias.gyro;
        s.accel += bias.accel;
    }
    let exact = Preintegrated::of(NOISE, bias, biased.clone());
    let plain = Preintegrated::of(NOISE, Bias::default(), samples(0.0, 0.5, 200.0));
    let close = |a: (So3, Vec3, Vec3), b: (So3, Vec3, Vec3)| {
        (a.0.inverse() * b.0).angle().max((a.1 - b.1).norm()).max((a.2 - b.2).norm())
    };
    assert!(close(exact.gained(&bias), plain.gained(&Bias::default())) < 1e-12);
    let near = Bias { gyro: bias.gyro * 0.9, accel: bias.accel * 0.8 };
    let corrected = Preintegrated::of(NOISE, near, biased.clone());
    assert!(!corrected.is_far(&bias));
    assert!(close(corrected.gained(&bias), exact.gained(&bias)) < 1e-5);
    let mut far = Preintegrated::of(NOISE, Bias::default(), biased);
    assert!(far.is_far(&bias));
    far.follow(&bias);
    assert!(close(far.gained(&bias), exact.gained(&bias)) < 1e-15);
    assert_eq!((far.covariance(), *far.bias()), (exact.covariance(), bias));
}

#[test]
fn pieces_joined_are_the_whole() {
    let all = samples(0.0, 1.0, 200.0);
    let mut joined = Preintegrated::of(NOISE, some_bias(), all[..=80].to_vec());
    joined.append(&Preintegrated::of(NOISE, some_bias(), all[80..].to_vec()));
    let whole = Preintegrated::of(NOISE, some_bias(), all);
    assert_eq!(joined.gained(&some_bias()).2, whole.gained(&some_bias()).2);
    assert_eq!((joined.covariance(), joined.seconds()), (whole.covariance(), whole.seconds()));
}

#[test]
fn every_jacobian_matches_differences() {
    let near = Bias { gyro: some_bias().gyro * 0.8, accel: some_bias().accel * 0.5 };
    let sum = Preintegrated::of(NOISE, near, samples(0.2, 0.6, 200.0));
    let mut rng = Random::new(4);
    let mut random = |scale: f64| SVector::<f64, 15>::from_fn(|_, _| scale * rng.standard_normal());
    let from = HandMotion::state(0.2, some_bias()).retract(&random(0.05));
    let to = HandMotion::state(0.8, some_bias()).retract(&random(0.05));
    let gravity = Gravity::along(&Vec3::new(0.4, -0.3, -9.0), 9.81).unwrap();
    let linear = sum.linearise(&from, &to, &gravity);
    assert_eq!(linear.residual, sum.residual(&from, &to, &gravity));
    let h = 1e-6;
    let check = |numeric: SVector<f64, 15>, analytic: SVector<f64, 15>, what: &str| {
        assert!(
            (numeric - analytic).norm() < 2e-6 * analytic.norm().max(1.0),
            "{what}: {numeric} {analytic}"
        );
    };
    for k in 0..15 {
        let mut d = SVector::<f64, 15>::zeros();
        d[k] = h;
        let differ = |plus: SVector<f64, 15>, minus: SVector<f64, 15>| (plus - minus) / (2.0 * h);
        let moved = differ(
            sum.residual(&from.retract(&d), &to, &gravity),
            sum.residual(&from.retract(&-d), &to, &gravity),
        );
        check(moved, linear.by_from.column(k).into(), &format!("from {k}"));
        let moved = differ(
            sum.residual(&from, &to.retract(&d), &gravity),
            sum.residual(&from, &to.retract(&-d), &gravity),
        );
        check(moved, linear.by_to.column(k).into(), &format!("to {k}"));
    }
    for k in 0..2 {
        let mut d = Vector2::zeros();
        d[k] = h;
        let (plus, minus) = (gravity.retract(&d), gravity.retract(&-d));
        let moved = (sum.residual(&from, &to, &plus) - sum.residual(&from, &to, &minus)) / (2.0 * h);
        check(moved, linear.by_gravity.column(k).into(), &format!("gravity {k}"));
    }
    // Scale: both positions, less a lever arm, are multiplied.
    let arm = Vec3::new(0.1, -0.05, 0.02);
    let camera = |s: &NavState| s.world_from_imu * -arm;
    let scaled = |state: &NavState, log: f64| {
        let mut out = *state;
        out.world_from_imu.translation = camera(state) * log.exp() + out.world_from_imu.rotation * arm;
        out
    };
    let at = |log: f64| sum.residual(&scaled(&from, log), &scaled(&to, log), &gravity);
    check((at(h) - at(-h)) / (2.0 * h), linear.by_log_scale(&(camera(&to) - camera(&from))), "scale");
}

/// A run of noisy readings with wandering biases: the squared error of the propagated state, whitened by its covariance.
fn nees(rng: &mut Random, seconds: f64, rate: f64) -> f64 {
    let (readings, bias) = noisy(rng, samples(0.1, seconds, rate), some_bias());
    let sum = Preintegrated::of(NOISE, some_bias(), readings);
    let truth = HandMotion::state(0.1 + seconds, bias);
    let residual = sum.residual(&HandMotion::state(0.1, some_bias()), &truth, &Gravity::level());
    (sum.whitening().unwrap() * residual).norm_squared()
}

/// The 95 % band of the mean of 100 chi-squares of 15 degrees: `15 +- 1.96 sqrt(2 * 15 / 100)`.
#[test]
fn propagated_states_are_consistent_over_a_hundred_runs() {
    for (seed, seconds) in [(1, 0.5), (2, 2.0), (3, 5.0)] {
        let mut rng = Random::new(seed);
        let mean = (0..100).map(|_| nees(&mut rng, seconds, 200.0)).sum::<f64>() / 100.0;
        println!("NEES over 100 runs of {seconds} s: {mean:.2} (15 expected)");
        assert!((mean - 15.0).abs() < 1.96 * (2.0f64 * 15.0 / 100.0).sqrt(), "{seconds} s: {mean}");
    }
}

/// The covariance itself against that of many runs' errors (the NEES alone would not see errors that cancel).
#[test]
fn the_covariance_is_that_of_the_errors() {
    let sum = Preintegrated::of(NOISE, Bias::default(), samples(0.0, 1.0, 100.0));
    let mut rng = Random::new(9);
    let mut found = SMatrix::<f64, 9, 9>::zeros();
    let runs = 2000;
    for _ in 0..runs {
        let mut noisy = samples(0.0, 1.0, 100.0);
        let mut vector =
            |s: f64| Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s;
        for s in &mut noisy {
            s.gyro += vector(NOISE.gyro * 10.0);
            s.accel += vector(NOISE.accel * 10.0);
        }
        let (r0, v0, p0) = sum.gained(&Bias::default());
        let (r, v, p) = Preintegrated::of(NOISE, Bias::default(), noisy).gained(&Bias::default());
        let mut e = SVector::<f64, 9>::zeros();
        e.fixed_rows_mut::<3>(0).copy_from(&(r0.inverse() * r).log());
        e.fixed_rows_mut::<3>(3).copy_from(&(v - v0));
        e.fixed_rows_mut::<3>(6).copy_from(&(p - p0));
        found += e * e.transpose() / runs as f64;
    }
    let still = ImuNoise { gyro_walk: 1e-12, accel_walk: 1e-12, ..NOISE };
    let told = Preintegrated::of(still, Bias::default(), samples(0.0, 1.0, 100.0)).motion_covariance();
    for i in 0..9 {
        for j in 0..9 {
            let scale = (told[(i, i)] * told[(j, j)]).sqrt();
            assert!(
                (found[(i, j)] - told[(i, j)]).abs() < 0.12 * scale,
                "{i} {j}: {} {}",
                found[(i, j)],
                told[(i, j)]
            );
        }
    }
}

/// Printed, not judged tightly: the machine may be busy.
#[test]
fn a_sample_costs_little() {
    let all = samples(0.0, 5.0, 200.0);
    let mut best = f64::INFINITY;
    for _ in 0..20 {
        let start = std::time::Instant::now();
        let sum = Preintegrated::of(NOISE, Bias::default(), all.clone());
        best = best.min(start.elapsed().as_secs_f64() / sum.samples().len() as f64);
    }
    println!("{:.0} ns a sample", best * 1e9);
    assert!(best < 20e-6);
}
