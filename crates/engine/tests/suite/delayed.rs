//! One camera with the IMU of a phone, out, a turn on the spot and home, while mapping and closing lag by latencies drawn
//! by a seed: the scale stays right, and the run is reproducible.

use cairn_engine::{Config, Delays, Engine, Host, Output, Runner, SensorMode};
use cairn_eval::{Align, EvalOptions, evaluate};
use cairn_geometry::{Se3, Trajectory, Vec2};
use cairn_sensor::{Camera, ImuNoise, Source, Stamp};
use cairn_sim::{CameraPath, ImuConfig, SimConfig, SimSource, Walker, WorldKind};
use std::collections::BTreeMap;

/// Metres walked out.
const OUT_M: f64 = 7.0;

/// A walker with a phone: 60 readings a second, and a rig that states ten times their noise.
fn phone(seed: u64) -> SimSource {
    let mut config = SimConfig::new(WorldKind::Demo, seed);
    config.sensor = cairn_sim::SimSensor::Mono;
    config.camera = Camera::pinhole(400, 300, 262.0, 262.0, 199.5, 149.5);
    config.rate_hz = 15.0;
    config.options.detail = 0.5;
    config.walker = Walker { turn_rate: 0.8, ..Walker::default() };
    config.imu = Some(ImuConfig { rate_hz: 60.0, ..ImuConfig::default() });
    let start = Vec2::new(0.0, 0.0);
    let plain = SimSource::new(&SimConfig { duration_s: Some(0.1), ..config.clone() }).unwrap();
    let route = plain.world().routes()[0].points.clone();
    let (from, to) = (route[0], route[1]);
    let end = from + (to - from).try_normalize(1e-9).unwrap_or(start) * OUT_M.min((to - from).norm());
    config.route = CameraPath::Points(vec![from, end, from]);
    SimSource::in_world(&config, plain.world().clone()).unwrap()
}

/// The engine at the end, the outputs, and the truth.
fn walk(delays: Delays) -> (Engine, Vec<Output>, Vec<(Stamp, Se3)>) {
    let mut source = phone(3);
    let mut rig = source.rig().clone();
    let noise = ImuNoise { gyro: 3e-3, gyro_walk: 1e-4, accel: 3e-2, accel_walk: 1e-3 };
    rig.imu.as_mut().unwrap().noise = noise;
    let mut config = Config::default();
    config.inertial.enabled = true;
    let runner = Runner::Delayed(delays);
    let mut engine = Engine::new(&rig, SensorMode::Mono, 15.0, runner, &config, &Host::bare()).unwrap();
    let mut outputs = Vec::new();
    while let Some(packet) = source.next_packet().unwrap() {
        outputs.push(engine.on_packet(&packet).unwrap());
    }
    assert!(outputs.iter().all(|o: &Output| o.stage_failed().is_none()));
    engine.finish();
    engine.snapshot().check().unwrap();
    let truth = source.info().truth.clone();
    (engine, outputs, truth)
}

/// Seconds of walking in which the odometry called metric is more than a tenth off, over two seconds each.
fn wrong_s(outputs: &[Output], truth: &[(Stamp, Se3)]) -> f64 {
    let truth: BTreeMap<Stamp, Se3> = truth.iter().copied().collect();
    let told: Vec<_> =
        outputs.iter().filter(|o| o.is_metric()).filter_map(|o| Some((o.stamp, o.pose?.odometry))).collect();
    let mut wrong_s = 0.0;
    for (i, (to, now)) in told.iter().enumerate() {
        let Some((from, then)) = told[..i].iter().rev().find(|(t, _)| *to - *t >= 2.0) else { continue };
        let truly = (truth[to].translation - truth[from].translation).norm();
        if truly < 1.0 || then.segment != now.segment {
            continue;
        }
        let moved = now.odom_from_body.se3.translation - then.odom_from_body.se3.translation;
        let off = (moved.norm() * now.world_from_odom.sim3.scale / truly).ln().abs();
        wrong_s += if off > 0.1 { *to - told[i - 1].0 } else { 0.0 };
    }
    wrong_s
}

#[test]
fn scale_stays_right_while_mapping_lags() {
    let delays = Delays { seed: 1, most_frames: 8 };
    let (engine, outputs, truth) = walk(delays);
    let metric = outputs.iter().find(|o| o.is_metric()).expect("scale is found").stamp - outputs[0].stamp;
    assert!(metric < 7.0, "{metric} s");
    assert!(wrong_s(&outputs, &truth) <= 2.0, "{} s", wrong_s(&outputs, &truth));
    let trajectory = |poses: Vec<(Stamp, Se3)>| {
        Trajectory::from_unsorted(poses.iter().map(|(t, p)| (t.0, *p)).collect()).unwrap()
    };
    let (truth, poses) = (trajectory(engine.comparable(&truth)), trajectory(engine.trajectory()));
    let found =
        evaluate(&truth, &poses, &EvalOptions { align: Align::Sim3, ..EvalOptions::default() }).unwrap();
    assert!((found.scale - 1.0).abs() < 0.03, "scale {}", found.scale);
    assert_eq!(engine.digest(), walk(delays).0.digest(), "the same seed gives the same bits");
}
