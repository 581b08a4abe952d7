//! Simulated IMU data agree with the simulated motion: one second of preintegrated data predicts the next state.

use cairn_geometry::Vec3;
use cairn_inertial::{Bias, Gravity, ImuBuffer, NavState};
use cairn_sensor::{GRAVITY_M_S2, Source, Stamp};
use cairn_sim::{SimConfig, SimSource};
use std::f64::consts::PI;

/// Errors after one second, starting every half second: position in metres and rotation in radians, RMS and maximum.
fn errors(text: &str, change: impl Fn(&mut SimConfig)) -> [[f64; 2]; 2] {
    let mut config = SimConfig::parse(&format!("{text}&resolution=32x24&detail=0.05&rate=2")).unwrap();
    change(&mut config);
    let mut source = SimSource::new(&config).unwrap();
    let (sensor, motion) = (source.rig().imu.clone().unwrap(), source.motion().clone());
    let stamps: Vec<Stamp> = source.info().truth.iter().map(|p| p.0).collect();
    let mut buffer = ImuBuffer::new(&sensor, 0.1);
    while let Some(packet) = source.next_packet().unwrap() {
        buffer.push(&packet.imu);
    }
    let state = |t: Stamp| {
        let s = motion.state(t - stamps[0]);
        NavState { world_from_imu: s.world_from_body, velocity: s.velocity, bias: Bias::default() }
    };
    let (mut squares, mut most, mut n) = ([0.0; 2], [0.0f64; 2], 0.0);
    let gravity = Gravity::along(&-Vec3::z(), GRAVITY_M_S2).unwrap();
    // The mean of the first pair of samples is later than the first image.
    for w in stamps[1..].windows(3) {
        let sum = buffer.preintegrate(Bias::default(), w[0], w[2]).unwrap();
        let found = sum.predict(&state(w[0]), &gravity.vector()).world_from_imu;
        let truth = state(w[2]).world_from_imu;
        let off = [
            (found.translation - truth.translation).norm(),
            (found.rotation.inverse() * truth.rotation).angle(),
        ];
        for k in 0..2 {
            squares[k] += off[k] * off[k];
            most[k] = most[k].max(off[k]);
        }
        n += 1.0;
    }
    assert!(n > 10.0);
    [0, 1].map(|k| [f64::sqrt(squares[k] / n), most[k]])
}

#[test]
fn noise_free_imu_predicts_the_next_state() {
    let turning = |s: &mut SimConfig| s.walker.turn_rate = PI / 2.0;
    for (text, rate) in [
        ("sim:demo?sensor=mono-imu&imu_noise=0&duration=20", 200.0),
        ("sim:office?sensor=mono-imu&imu_noise=0&duration=20&imu_rate=400", 400.0),
        // Turning on the spot within two seconds.
        ("sim:dead-end?sensor=mono-imu&imu_noise=0&start=20&duration=12", 200.0),
    ] {
        let [place, turn] = errors(text, turning);
        // The error of the midpoint rule decreases with the square of the rate.
        let part = (200.0f64 / rate).powi(2);
        assert!(place[1] < 1e-3 * part.max(0.5) && turn[1] < 1e-4, "{text}: {place:?} m, {turn:?} rad");
    }
}

#[test]
fn noisy_imu_predicts_within_bounds() {
    // Most of the error is due to the unestimated biases: 0.02 m/s^2 and 2 mrad/s per axis.
    let [place, turn] = errors("sim:dead-end?sensor=mono-imu&start=15&duration=20&seed=3", |_| {});
    assert!((1e-3..0.05).contains(&place[0]) && place[1] < 0.08, "{place:?} m");
    assert!((2e-4..0.01).contains(&turn[0]), "{turn:?} rad");
    // Half the rate by means of pairs is as accurate for a walker.
    let [half, _] = errors("sim:dead-end?sensor=mono-imu&start=15&duration=20&seed=3&imu_mean=2", |_| {});
    assert!((half[0] - place[0]).abs() < 2e-3, "{half:?} against {place:?}");
}
