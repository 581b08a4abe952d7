//! Initialisation on simulated motion: what is found, how sure it is, and which gate stops what.

use crate::common;

use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{
    Attempt, Bias, GateKind, Gravity, ImuBuffer, Initial, InitialiseConfig, Preintegrated, Scale, Seen,
    SeenPose, initialise,
};
use cairn_random::Random;
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use common::{HandMotion, NOISE, noisy, samples, some_bias, vector};

const MAP_UNIT_M: f64 = 2.7;
const ROTATION_SIGMA: f64 = 0.002;
const POSITION_SIGMA_M: f64 = 0.002;

fn imu_from_camera() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(1.2, -1.1, 1.3)), Vec3::new(0.07, -0.02, 0.05))
}

/// A world that stands askew, in units of its own.
fn map_from_world() -> (So3, Vec3) {
    (So3::exp(&Vec3::new(0.8, -0.4, 0.3)), Vec3::new(3.0, -1.0, 0.5))
}

struct Case {
    poses: Vec<SeenPose>,
    links: Vec<Preintegrated>,
    position_sigma: f64,
}

/// Key frames along a motion given as the sensor's pose by time.
fn case(
    rng: &mut Random,
    readings: Vec<ImuSample>,
    pose: impl Fn(f64) -> Se3,
    from: f64,
    key_frames: usize,
    unit: f64,
) -> Case {
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise: NOISE, offset_s: 0.0 };
    let mut buffer = ImuBuffer::new(&sensor, 0.1);
    buffer.push(&readings);
    let (turn, shift) = map_from_world();
    let poses: Vec<SeenPose> = (0..key_frames)
        .map(|k| {
            let t = from + 0.25 * k as f64;
            let camera = pose(t) * imu_from_camera();
            let place = camera.translation + vector(rng, POSITION_SIGMA_M);
            let rotation = turn * camera.rotation * So3::exp(&vector(rng, ROTATION_SIGMA));
            SeenPose {
                stamp: Stamp::from_seconds(t),
                world_from_camera: Se3::new(rotation, (turn * place + shift) / unit),
            }
        })
        .collect();
    let link = |w: &[SeenPose]| buffer.preintegrate(Bias::default(), w[0].stamp, w[1].stamp).unwrap();
    Case { links: poses.windows(2).map(link).collect(), poses, position_sigma: POSITION_SIGMA_M / unit }
}

fn attempt(case: &Case, scale: Scale) -> Attempt {
    let seen =
        Seen { poses: &case.poses, rotation_sigma: ROTATION_SIGMA, position_sigma: case.position_sigma };
    let config = InitialiseConfig { noise_times: 1.0, ..Default::default() };
    initialise(&seen, &case.links, &imu_from_camera(), scale, &config)
}

fn in_motion(seed: u64, key_frames: usize, unit: f64) -> Case {
    let mut rng = Random::new(seed);
    let from = rng.uniform(0.0, 8.0);
    let (readings, _) = noisy(&mut rng, samples(from, 0.25 * key_frames as f64, 200.0), some_bias());
    case(
        &mut rng,
        readings,
        |t| Se3::new(HandMotion::rotation(t), HandMotion::position(t)),
        from,
        key_frames,
        unit,
    )
}

#[test]
fn scale_gravity_and_biases_are_found_and_as_good_as_told() {
    let (mut scale_nees, mut tilt_nees, mut bias_nees) = (0.0, 0.0, 0.0);
    let runs = 60;
    for seed in 0..runs {
        let attempt = attempt(&in_motion(seed, 20, MAP_UNIT_M), Scale::Free);
        let found = attempt.accepted().unwrap_or_else(|| panic!("{seed}: {:?}", attempt.gates));
        let down = map_from_world().0 * Gravity::level().vector();
        let truth = Gravity::along(&down, 9.80665).unwrap();
        let off = (found.scale / MAP_UNIT_M).ln();
        assert!(off.abs() < 0.03, "{seed}: scale {}", found.scale);
        assert!(found.gravity.vector().angle(&down).to_degrees() < 1.0, "{seed}");
        assert!((found.bias.gyro - some_bias().gyro).norm() < 2e-3, "{seed}: {:?}", found.bias);
        // Whitened errors: one, two and three degrees of freedom.
        // The accelerometer is exact here: the errors are those of white noise.
        scale_nees += off.powi(2) / found.noise_covariance[(0, 0)] / runs as f64;
        assert!(
            found.scale_sigma.powi(2) > found.noise_covariance[(0, 0)],
            "{seed}: what else may be wrong counts"
        );
        let tilt = cairn_geometry::Manifold::local(&found.gravity, &truth);
        let tilt_covariance = found.noise_covariance.fixed_view::<2, 2>(1, 1).into_owned();
        tilt_nees += tilt.dot(&(tilt_covariance.try_inverse().unwrap() * tilt)) / runs as f64;
        let bias = found.bias.gyro - some_bias().gyro;
        let bias_covariance = found.noise_covariance.fixed_view::<3, 3>(3, 3).into_owned();
        bias_nees += bias.dot(&(bias_covariance.try_inverse().unwrap() * bias)) / runs as f64;
        // The states are those of the sensor, in metres.
        let (turn, shift) = map_from_world();
        let at = turn * HandMotion::position(found_time(seed)) + shift;
        assert!((found.states[0].world_from_imu.translation - at).norm() < 0.2, "{seed}");
    }
    println!("NEES: scale {scale_nees:.2} (1), gravity {tilt_nees:.2} (2), gyro bias {bias_nees:.2} (3)");
    assert!((0.5..1.7).contains(&scale_nees), "{scale_nees}");
    assert!((1.0..3.4).contains(&tilt_nees), "{tilt_nees}");
    assert!((1.5..5.5).contains(&bias_nees), "{bias_nees}");
}

/// Accelerometers whose sensitivity is off by half a percent on each axis, as data sheets allow.
#[test]
fn sensitivity_of_the_accelerometer_is_part_of_the_scales_standard_deviation() {
    let (mut nees, mut of_white_noise) = (0.0, 0.0);
    let runs = 60;
    for seed in 0..runs {
        let mut rng = Random::new(100 + seed);
        let from = rng.uniform(0.0, 8.0);
        let factors = vector(&mut rng, 0.005).add_scalar(1.0);
        let mut readings = samples(from, 15.0, 200.0);
        readings.iter_mut().for_each(|s| s.accel.component_mul_assign(&factors));
        let (readings, _) = noisy(&mut rng, readings, some_bias());
        let pose = |t: f64| Se3::new(HandMotion::rotation(t), HandMotion::position(t));
        let attempt = attempt(&case(&mut rng, readings, pose, from, 60, MAP_UNIT_M), Scale::Free);
        let found = attempt.accepted().unwrap_or_else(|| panic!("{seed}: {:?}", attempt.gates));
        let off = (found.scale / MAP_UNIT_M).ln();
        nees += (off / found.scale_sigma).powi(2) / runs as f64;
        of_white_noise += off.powi(2) / found.noise_covariance[(0, 0)] / runs as f64;
    }
    println!("NEES of the scale: {nees:.2} (1), by white noise alone {of_white_noise:.2}");
    assert!((0.5..1.7).contains(&nees), "{nees}");
    assert!(of_white_noise > 1.7, "{of_white_noise}");
}

fn found_time(seed: u64) -> f64 {
    Random::new(seed).uniform(0.0, 8.0)
}

#[test]
fn longer_is_surer_and_any_unit_will_do() {
    let sigma = |n, unit| {
        let attempt = attempt(&in_motion(5, n, unit), Scale::Free);
        let found = attempt.found.expect("a minimum");
        assert!(
            (found.scale / unit).ln().abs() < 5.0 * found.scale_sigma + 0.01,
            "{n} {unit}: {}",
            found.scale
        );
        found.scale_sigma
    };
    let short = sigma(8, 1.0);
    let long = sigma(40, 1.0);
    assert!(long < 0.5 * short, "{short} {long}");
    assert!((sigma(40, 0.01) / long - 1.0).abs() < 0.2);
    assert!((sigma(40, 300.0) / long - 1.0).abs() < 0.2);
}

#[test]
fn known_scale_stays_and_needs_no_motion() {
    let found = attempt(&in_motion(3, 12, 1.0), Scale::Known { sigma: 1e-4 });
    let found = found.accepted().expect("accepted");
    assert!((found.scale - 1.0).abs() < 1e-3);
    let (still, _) = standing(1);
    let attempt = attempt(&still, Scale::Known { sigma: 1e-4 });
    let found = attempt.accepted().unwrap_or_else(|| panic!("{:?}", attempt.gates));
    let down = map_from_world().0 * Gravity::level().vector();
    // At rest the accelerometer's bias cannot be told from gravity's tilt.
    assert!(found.gravity.vector().angle(&down) < 3.0 * found.gravity_sigma.max(0.02));
    assert!((found.bias.gyro - some_bias().gyro).norm() < 1e-3);
    assert!(found.states.iter().all(|s| s.velocity.norm() < 0.02));
}

/// The poses of a motion, stamped so late, and the readings of the same time.
fn stamped_late(seed: u64, key_frames: usize, late_s: f64) -> Case {
    let mut rng = Random::new(seed);
    let from = rng.uniform(0.0, 8.0);
    let (readings, _) = noisy(&mut rng, samples(from, 0.25 * key_frames as f64, 200.0), some_bias());
    let pose = |t: f64| Se3::new(HandMotion::rotation(t - late_s), HandMotion::position(t - late_s));
    case(&mut rng, readings, pose, from, key_frames, MAP_UNIT_M)
}

#[test]
fn offset_of_the_clocks_is_found_with_the_scale() {
    let mut nees = 0.0;
    let runs = 20;
    for seed in 0..runs {
        let late_s = 0.03 * (seed as f64 / runs as f64 - 0.5);
        let case = stamped_late(seed, 16, late_s);
        let seen =
            Seen { poses: &case.poses, rotation_sigma: ROTATION_SIGMA, position_sigma: case.position_sigma };
        let config = InitialiseConfig { noise_times: 1.0, offset_sigma_s: 0.03, ..Default::default() };
        let attempt = initialise(&seen, &case.links, &imu_from_camera(), Scale::Free, &config);
        let found = attempt.accepted().unwrap_or_else(|| panic!("{seed}: {:?}", attempt.gates));
        assert!(found.offset_sigma_s < 2e-3, "{seed}: {} s", found.offset_sigma_s);
        nees += ((found.offset_s - late_s) / found.offset_sigma_s).powi(2) / runs as f64;
        assert!((found.scale / MAP_UNIT_M).ln().abs() < 4.0 * found.scale_sigma, "{seed}: {}", found.scale);
        // Where the clocks are taken to agree, the IMU is blamed.
        let known = InitialiseConfig { offset_sigma_s: 0.0, ..config };
        let blamed = initialise(&seen, &case.links, &imu_from_camera(), Scale::Free, &known).found;
        if late_s.abs() > 0.01 {
            let worse = blamed.is_none_or(|b| b.scale_sigma > 1.3 * found.scale_sigma);
            assert!(worse, "{seed}: an offset of {late_s} s must show");
        }
    }
    println!("NEES of the offset {nees:.2} (1)");
    assert!(nees < 3.0, "{nees}");
}

/// Where nobody knows where the camera is on the IMU, it is found with the scale, whose standard deviation then says so; where it is taken
/// as known, it spoils the scale by more than is said.
#[test]
fn lever_arm_is_found_with_the_scale() {
    let (mut arms_off, mut off, mut blamed_off) = (Vec::new(), 0.0, 0.0);
    let runs = 20;
    for seed in 0..runs {
        let case = in_motion(seed, 24, MAP_UNIT_M);
        let wrong = vector(&mut Random::new(1000 + seed), 0.03);
        let truth = imu_from_camera();
        let stated = Se3::new(truth.rotation, truth.translation + wrong);
        let seen =
            Seen { poses: &case.poses, rotation_sigma: ROTATION_SIGMA, position_sigma: case.position_sigma };
        let found = |lever_arm_sigma: f64| {
            let config = InitialiseConfig { noise_times: 1.0, lever_arm_sigma, ..Default::default() };
            initialise(&seen, &case.links, &stated, Scale::Free, &config).found.expect("a minimum")
        };
        let nees = |found: &Initial| ((found.scale / MAP_UNIT_M).ln() / found.scale_sigma).powi(2);
        let (free, held) = (found(0.04), found(0.0));
        arms_off.push((free.lever_arm - truth.translation).norm() / wrong.norm());
        assert!((held.lever_arm - stated.translation).norm() < 1e-6, "{seed}: it is held");
        off += nees(&free) / runs as f64;
        blamed_off += nees(&held) / runs as f64;
    }
    arms_off.sort_by(f64::total_cmp);
    println!(
        "NEES of the scale {off:.2} (1), with the arm held {blamed_off:.2}; arms {arms_off:.2?} of what they were off"
    );
    assert!(arms_off[arms_off.len() / 2] < 0.5, "{arms_off:?}");
    assert!(off < 2.0 && blamed_off > 2.0 * off, "{off} {blamed_off}");
}

#[test]
fn noise_of_the_poses_is_fitted_where_it_is_overstated() {
    for seed in 0..10 {
        let case = in_motion(seed, 24, MAP_UNIT_M);
        let of = |times: f64| {
            let (rotation_sigma, position_sigma) = (times * ROTATION_SIGMA, times * case.position_sigma);
            let seen = Seen { poses: &case.poses, rotation_sigma, position_sigma };
            let config = InitialiseConfig { noise_times: 1.0, ..Default::default() };
            initialise(&seen, &case.links, &imu_from_camera(), Scale::Free, &config).found.expect("a minimum")
        };
        let (right, over) = (of(1.0), of(8.0));
        assert!(over.position_sigma <= 2.0 * case.position_sigma, "{seed}: {}", over.position_sigma);
        assert!(right.position_sigma >= 0.5 * case.position_sigma, "{seed}: {}", right.position_sigma);
        let sigmas = over.scale_sigma / right.scale_sigma;
        assert!((0.5..2.0).contains(&sigmas), "{seed}: {sigmas}");
    }
}

fn standing(seed: u64) -> (Case, Vec<ImuSample>) {
    let mut rng = Random::new(seed);
    let still = |i: i64| ImuSample::new(Stamp(i * 5_000_000), Vec3::zeros(), -Gravity::level().vector());
    let (readings, _) = noisy(&mut rng, (0..=1000).map(still).collect(), some_bias());
    (case(&mut rng, readings.clone(), |_| Se3::identity(), 0.0, 16, 1.0), readings)
}

#[test]
fn each_gate_stops_what_it_is_there_for() {
    let failed = |attempt: &Attempt| attempt.failed().map(|g| g.kind).collect::<Vec<_>>();
    // Standing still, one camera: no excitation, no baseline, and no scale.
    let still = attempt(&standing(2).0, Scale::Free);
    let kinds = failed(&still);
    assert!(
        kinds.contains(&GateKind::Excitation) && kinds.contains(&GateKind::Baseline),
        "{:?}",
        still.gates
    );
    assert!(still.gates.iter().any(|g| g.kind == GateKind::Excitation && g.value < 0.05));
    // Constant velocity without a turn: the same readings, but the camera moves.
    let mut rng = Random::new(3);
    let readings = standing(3).1;
    let straight = |t: f64| Se3::new(So3::identity(), Vec3::x() * t);
    let straight = attempt(&case(&mut rng, readings, straight, 0.0, 16, 1.0), Scale::Free);
    assert!(
        straight.accepted().is_none() && failed(&straight).contains(&GateKind::Excitation),
        "{:?}",
        straight.gates
    );
    // Too few, too short, broken links.
    let mut short = in_motion(4, 4, 1.0);
    assert_eq!(failed(&attempt(&short, Scale::Free)), [GateKind::KeyFrames, GateKind::Seconds]);
    assert!(attempt(&short, Scale::Free).found.is_none());
    short = in_motion(4, 12, 1.0);
    short.links.remove(3);
    assert!(failed(&attempt(&short, Scale::Free)).contains(&GateKind::Links));
    let empty = Case { poses: vec![], links: vec![], position_sigma: 0.1 };
    assert!(!failed(&attempt(&empty, Scale::Free)).is_empty());
    // An accelerometer in units of its own, and poses that are none.
    let mut rng = Random::new(6);
    let (mut readings, _) = noisy(&mut rng, samples(0.0, 6.0, 200.0), Bias::default());
    readings.iter_mut().for_each(|s| s.accel *= 1.3);
    let pose = |t: f64| Se3::new(HandMotion::rotation(t), HandMotion::position(t));
    let wrong = attempt(&case(&mut rng, readings, pose, 0.0, 24, 1.0), Scale::Known { sigma: 0.01 });
    assert!(failed(&wrong).contains(&GateKind::GravityNorm), "{:?}", wrong.gates);
    let (readings, _) = noisy(&mut rng, samples(0.0, 6.0, 200.0), Bias::default());
    let mirrored = |t: f64| Se3::new(HandMotion::rotation(t).inverse(), -HandMotion::position(t));
    let wrong = attempt(&case(&mut rng, readings, mirrored, 0.0, 24, 1.0), Scale::Free);
    assert!(wrong.accepted().is_none() && failed(&wrong).contains(&GateKind::GyroNoise), "{:?}", wrong.gates);
    assert!(wrong.gates.iter().all(|g| g.to_string().contains(if g.passed { "good" } else { "failed" })));
}
