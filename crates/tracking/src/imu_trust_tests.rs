//! Readings that are sound, and readings with faults, beside the poses of a camera that sees well.

use crate::imu_trust::{Belief, ImuTrust};
use crate::state::AnchoredPose;
use cairn_atlas::{Change, ChangeSet, KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, ImuBuffer, ImuFault};
use cairn_random::Random;
use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, ImuSensor, Stamp};
use cairn_vision::Frame;
use std::sync::Arc;

const NOISE: ImuNoise = ImuNoise { gyro: 1.7e-4, gyro_walk: 2e-5, accel: 2e-3, accel_walk: 3e-3 };

/// Pose of a hand that swings.
fn pose(t: f64) -> Se3 {
    let turn = So3::exp(&Vec3::new(0.4 * (2.3 * t).sin(), 0.3 * (3.1 * t).cos(), 0.5 * t));
    Se3::new(turn, Vec3::new(0.4 * (2.0 * t).sin(), 0.3 * (3.0 * t).cos(), 0.2 * (4.0 * t).sin()))
}

fn reading(t: f64, noise: &mut impl FnMut() -> Vec3) -> ImuSample {
    let h = 1e-4;
    let place = |t: f64| pose(t).translation;
    let acceleration = (place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h);
    let rate = (pose(t - h).rotation.inverse() * pose(t + h).rotation).log() / (2.0 * h);
    let force = pose(t).rotation.inverse() * (acceleration + Vec3::z() * GRAVITY_M_S2);
    ImuSample::new(Stamp::from_seconds(t), rate + noise() * 0.0024, force + noise() * 0.028)
}

/// When readings are given up and when they are taken up again, in twelve seconds of a camera at 20 Hz and an IMU at 200 Hz, whose
/// readings are changed from the fourth second to the eighth.
fn told(aligned: bool, change: impl Fn(f64, ImuSample, &ImuSample) -> Option<ImuSample>) -> Vec<(f64, bool)> {
    let id = KeyFrameId::from_index(0).unwrap();
    let root = KeyFrame::new(id, Arc::new(Frame::default()), Se3::identity(), None);
    let changes = vec![Change::AddKeyFrame(Box::new(root))];
    let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise: NOISE, offset_s: 0.0 };
    let (mut trust, mut buffer) = (ImuTrust::default(), ImuBuffer::in_stream(&sensor));
    let gravity = aligned.then(|| Vec3::z() * -GRAVITY_M_S2);
    let belief = Belief { bias: Bias::default(), gravity, imu_from_camera: Se3::identity() };
    let mut random = Random::new(5);
    let (mut last, mut found) = (reading(0.0, &mut || Vec3::zeros()), Vec::new());
    for i in 0..2400 {
        let t = 0.005 * f64::from(i);
        let mut noise = || Vec3::from_fn(|_, _| random.standard_normal());
        let sound = reading(t, &mut noise);
        let changed = if (4.0..8.0).contains(&t) { change(t, sound, &last) } else { Some(sound) };
        if !(4.0..8.0).contains(&t) {
            last = sound;
        }
        if let Some(sample) = changed.filter(|s| trust.take(s)) {
            buffer.push(&[sample]);
        }
        if i % 10 == 0 {
            let own = pose(t);
            let turn = own.rotation * So3::exp(&(noise() * 0.002));
            let seen = AnchoredPose::at(id, Se3::new(turn, own.translation + noise() * 0.003));
            let anchored = AnchoredPose { reference_from_camera: seen.world_from_camera, ..seen };
            trust.see(&snapshot, Stamp::from_seconds(t), &anchored, &buffer, &belief);
        }
        let is_believed = trust.fault().is_none();
        if found.last().is_none_or(|(_, before)| *before) != is_believed {
            found.push((t, is_believed));
        }
    }
    found
}

/// Given up within so many seconds, and taken up again within two seconds after the end.
fn is_noticed(found: &[(f64, bool)], within_s: f64) -> bool {
    matches!(found, [(begin, false), (end, true)]
        if (4.0..4.0 + within_s).contains(begin) && (8.0..10.0).contains(end))
}

#[test]
fn sound_readings_are_believed() {
    assert_eq!(told(true, |_, s, _| Some(s)), []);
    assert_eq!(told(false, |_, s, _| Some(s)), []);
}

#[test]
fn faults_of_the_readings_themselves_are_noticed_at_once_and_their_end_too() {
    for aligned in [true, false] {
        let stuck = told(aligned, |_, s, last| Some(ImuSample { stamp: s.stamp, ..*last }));
        assert!(is_noticed(&stuck, 0.06), "{stuck:?}");
        let zeros = told(aligned, |_, s, _| Some(ImuSample::new(s.stamp, Vec3::zeros(), Vec3::zeros())));
        assert!(is_noticed(&zeros, 0.06), "{zeros:?}");
        let dead = told(aligned, |_, s, _| Some(ImuSample { gyro: Vec3::zeros(), ..s }));
        assert!(is_noticed(&dead, 0.06), "{dead:?}");
        let silent = told(aligned, |_, _, _| None);
        assert!(is_noticed(&silent, 0.4), "{silent:?}");
    }
}

#[test]
fn readings_of_another_motion_are_noticed_by_what_vision_saw() {
    let late = told(true, |t, s, _| Some(ImuSample { stamp: s.stamp, ..reading(t - 0.5, &mut Vec3::zeros) }));
    assert!(is_noticed(&late, 0.8), "{late:?}");
    let degrees = told(true, |_, s, _| Some(ImuSample { gyro: s.gyro * 5.0, ..s }));
    assert!(is_noticed(&degrees, 0.4), "{degrees:?}");
    let pushed = told(true, |_, s, _| Some(ImuSample { accel: s.accel + Vec3::x() * 4.0, ..s }));
    assert!(is_noticed(&pushed, 0.8), "{pushed:?}");
}

#[test]
fn a_reading_beyond_any_sensor_is_left_out_alone() {
    let spike = |t: f64| (t * 4.0).fract() < 0.004;
    let spikes =
        told(true, |t, s, _| Some(if spike(t) { ImuSample { gyro: Vec3::x() * 35.0, ..s } } else { s }));
    assert_eq!(spikes, []);
}

/// Lines of numbers, separated by commas or spaces.
fn numbers(text: &str) -> Vec<Vec<f64>> {
    let of = |line: &str| line.split([',', ' ']).map(|v| v.trim().parse().ok()).collect::<Option<Vec<f64>>>();
    text.lines().filter(|l| !l.starts_with('#')).filter_map(of).collect()
}

/// Readings, and poses with their times.
type Recorded = (Vec<ImuSample>, Vec<(Stamp, Se3)>);

/// A recording's readings, and its true poses; `None` where it is not there.
fn recorded(folder: &str) -> Option<Recorded> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data");
    let data = std::env::var("CAIRN_DATA").unwrap_or_else(|_| beside.into());
    let read = |name: &str| std::fs::read_to_string(format!("{data}/{folder}/{name}")).ok();
    let csv = read("imu.csv").or_else(|| read("mav0/imu0/data.csv"))?;
    let stamp = |line: &str| line.split(',').next()?.trim().parse().ok().map(Stamp);
    let stamps = csv.lines().filter(|l| !l.starts_with('#')).filter_map(stamp);
    let vector = |v: &[f64]| Vec3::new(v[0], v[1], v[2]);
    let samples = stamps.zip(numbers(&csv)).map(|(t, v)| ImuSample::new(t, vector(&v[1..]), vector(&v[4..])));
    let pose = |p: &[f64], [w, x, y, z]: [f64; 4]| {
        let turn = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(w, x, y, z));
        Se3::new(So3::exp(&turn.scaled_axis()), vector(p))
    };
    let truth = match read("gt_tum.txt") {
        Some(text) => {
            let of = |v: &Vec<f64>| (Stamp::from_seconds(v[0]), pose(&v[1..], [v[7], v[4], v[5], v[6]]));
            numbers(&text).iter().map(of).collect()
        }
        None => {
            let text = read("mav0/state_groundtruth_estimate0/data.csv")?;
            let of = |v: &Vec<f64>| (Stamp(v[0] as i64), pose(&v[1..], [v[4], v[5], v[6], v[7]]));
            numbers(&text).iter().map(of).collect()
        }
    };
    Some((samples.collect(), truth))
}

/// The mean difference of gyroscope and true turns.
fn gyro_bias(samples: &[ImuSample], truth: &[(Stamp, Se3)]) -> Vec3 {
    let mean = |from: Stamp, to: Stamp| {
        let within = |s: &&ImuSample| s.stamp >= from && s.stamp <= to;
        let (sum, n) =
            samples.iter().filter(within).fold((Vec3::zeros(), 0.0), |(a, n), s| (a + s.gyro, n + 1.0));
        (n > 0.0).then(|| sum / n)
    };
    let steps = truth.windows(11).step_by(200).filter_map(|w| {
        let turned = (w[0].1.rotation.inverse() * w[10].1.rotation).log();
        Some(mean(w[0].0, w[10].0)? - turned / (w[10].0 - w[0].0))
    });
    let all: Vec<Vec3> = steps.collect();
    all.iter().sum::<Vec3>() / all.len().max(1) as f64
}

/// What is told of readings beside the true poses, seen with noise, of 20 images a second: seconds since the first pose, and the fault.
fn told_beside(samples: &[ImuSample], truth: &[(Stamp, Se3)], gyro: Vec3) -> Vec<(f64, ImuFault)> {
    let id = KeyFrameId::from_index(0).unwrap();
    let root = KeyFrame::new(id, Arc::new(Frame::default()), Se3::identity(), None);
    let changes = vec![Change::AddKeyFrame(Box::new(root))];
    let snapshot = Snapshot::new().apply(&ChangeSet { base: 0, changes }).0;
    let sensor = ImuSensor { body_from_imu: Se3::identity(), rate_hz: 200.0, noise: NOISE, offset_s: 0.0 };
    let (mut trust, mut buffer) = (ImuTrust::default(), ImuBuffer::in_stream(&sensor));
    let bias = Bias { gyro, accel: Vec3::zeros() };
    let gravity = Some(Vec3::z() * -GRAVITY_M_S2);
    let belief = Belief { bias, gravity, imu_from_camera: Se3::identity() };
    let (mut random, mut next, mut due) = (Random::new(5), 0, truth[0].0);
    let (mut was_believed, mut found) = (true, Vec::new());
    for (stamp, own) in truth {
        if *stamp < due {
            continue;
        }
        due = stamp.plus_seconds(0.05);
        while samples.get(next).is_some_and(|s| s.stamp.plus_seconds(-0.005) <= *stamp) {
            if trust.take(&samples[next]) {
                buffer.push(&samples[next..=next]);
            }
            next += 1;
        }
        buffer.forget_before(stamp.plus_seconds(-3.0));
        let mut noise = || Vec3::from_fn(|_, _| random.standard_normal());
        let turn = own.rotation * So3::exp(&(noise() * 0.002));
        let seen = AnchoredPose::at(id, Se3::new(turn, own.translation + noise() * 0.003));
        let anchored = AnchoredPose { reference_from_camera: seen.world_from_camera, ..seen };
        trust.see(&snapshot, *stamp, &anchored, &buffer, &belief);
        if let (true, Some(failed)) = (was_believed, trust.fault()) {
            found.push((*stamp - truth[0].0, failed.fault));
        }
        was_believed = trust.fault().is_none();
    }
    found
}

/// Not one reading of real sensors is given up, in twelve minutes of drones, hands and rendered walks, beside their true poses.
#[test]
fn readings_of_real_sensors_are_believed() {
    let folders = ["euroc-mh01", "atrium", "house", "imu-truth/MH_03_medium", "imu-truth/V1_02_medium"];
    let others = ["imu-truth/V2_01_easy", "imu-truth/tumvi_room1", "imu-truth/tumvi_room3"];
    for folder in folders.into_iter().chain(others) {
        let Some((samples, truth)) = recorded(folder) else {
            eprintln!("skipped: {folder} is not there");
            continue;
        };
        let found = told_beside(&samples, &truth, gyro_bias(&samples, &truth));
        assert_eq!(found, [], "{folder}");
    }
}

/// Faults put into real readings at moments all over the recordings are noticed: how many of them, and after how long at most.
#[test]
fn faults_of_real_sensors_are_noticed_at_any_moment() {
    type Change = fn(&ImuSample, &ImuSample) -> ImuSample;
    let faults: [(&str, Change); 8] = [
        ("stuck", |s, last| ImuSample { stamp: s.stamp, ..*last }),
        ("zeros", |s, _| ImuSample::new(s.stamp, Vec3::zeros(), Vec3::zeros())),
        ("accelerometer dead", |s, _| ImuSample { accel: Vec3::zeros(), ..*s }),
        ("gyroscope dead", |s, _| ImuSample { gyro: Vec3::zeros(), ..*s }),
        ("degrees", |s, _| ImuSample { gyro: s.gyro * 57.3, ..*s }),
        ("clock +0.5 s", |s, _| ImuSample { stamp: s.stamp.plus_seconds(0.5), ..*s }),
        ("clock -0.5 s", |s, _| ImuSample { stamp: s.stamp.plus_seconds(-0.5), ..*s }),
        ("clock +0.05 s", |s, _| ImuSample { stamp: s.stamp.plus_seconds(0.05), ..*s }),
    ];
    for folder in ["euroc-mh01", "atrium", "imu-truth/tumvi_room1"] {
        let Some((samples, truth)) = recorded(folder) else {
            eprintln!("skipped: {folder} is not there");
            continue;
        };
        let gyro = gyro_bias(&samples, &truth);
        for (name, change) in faults {
            let (mut noticed, mut slowest) = (0, 0.0f64);
            for moment in 0..10 {
                // MH_01 is moved from its third second of true poses on, for ten.
                let from = truth[0].0.plus_seconds(4.0 + 0.9 * f64::from(moment));
                let part: Vec<_> = truth.iter().copied().take_while(|(t, _)| *t - from < 2.0).collect();
                let mut last = samples[0];
                let changed = samples.iter().map(|s| match s.stamp < from {
                    true => {
                        last = *s;
                        *s
                    }
                    false => change(s, &last),
                });
                let changed: Vec<ImuSample> = changed.collect();
                let found = told_beside(&changed, &part, gyro);
                let after = found.first().map(|(t, _)| *t - (from - truth[0].0));
                noticed += usize::from(after.is_some());
                slowest = slowest.max(after.unwrap_or(0.0));
            }
            eprintln!("{folder} {name}: {noticed} of 10, slowest {slowest:.2} s");
            // Readings of another time are noticed once the camera moves otherwise than it did then; 50 ms hardly show.
            let (least, most_s) = match name {
                "clock +0.05 s" => (0, 2.0),
                "clock -0.5 s" => (9, 2.0),
                _ => (10, 1.0),
            };
            assert!(noticed >= least && slowest < most_s, "{folder} {name}: {noticed} of 10, {slowest} s");
        }
    }
}
