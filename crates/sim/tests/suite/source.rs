//! The contract of the simulated source: times, determinism, IMU readings, errors.

use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{FramePacket, GRAVITY_M_S2, ImuSample, Source, Stamp};
use cairn_sim::{CameraPath, Effects, LiveRig, SimConfig, SimSource, WorldKind};

fn small(text: &str) -> SimConfig {
    SimConfig::parse(&format!("{text}&resolution=160x120&detail=0.2")).unwrap()
}

fn all(config: &SimConfig) -> Vec<FramePacket> {
    let mut source = SimSource::new(config).unwrap();
    std::iter::from_fn(|| source.next_packet().unwrap()).collect()
}

#[test]
fn same_config_gives_same_bytes() {
    let s = small("sim:hall?seed=5&sensor=rgbd-imu&duration=0.3&passers=2&blur=8");
    let (a, b) = (all(&s), all(&s));
    assert_eq!(a.len(), 7);
    for (a, b) in a.iter().zip(&b) {
        assert_eq!((a.stamp, &a.images, &a.depth, &a.imu), (b.stamp, &b.images, &b.depth, &b.imu));
    }
    let other = all(&small("sim:hall?seed=6&sensor=rgbd-imu&duration=0.3&passers=2&blur=8"));
    assert_ne!(a[0].images, other[0].images);
}

#[test]
fn times_increase_and_packets_hold_their_samples() {
    for rate in [20.0, 30.0, 7.3] {
        let packets = all(&small(&format!("sim:demo?duration=1.5&rate={rate}")));
        let stamps: Vec<Stamp> = packets.iter().map(|p| p.stamp).collect();
        assert!(stamps.windows(2).all(|w| w[0] < w[1]));
        let imu: Vec<ImuSample> = packets.iter().flat_map(|p| p.imu.clone()).collect();
        assert!(imu.windows(2).all(|w| w[0].stamp < w[1].stamp));
        let mut last = Stamp(i64::MIN);
        for p in &packets {
            last = p.imu.last().map_or(last, |s| s.stamp);
            assert!(last >= p.stamp, "no sample at or after {}", p.stamp);
            assert!(last - p.stamp < 0.0051);
        }
    }
}

#[test]
fn exact_readings_integrate_to_ground_truth() {
    for text in [
        "sim:demo?sensor=mono-imu&imu_noise=0&start=4&duration=11",
        "sim:office?sensor=mono-imu&imu_noise=0&start=8&duration=11",
    ] {
        let source = SimSource::new(&small(text)).unwrap();
        let motion = source.motion().clone();
        let start = motion.state(0.0);
        let (mut rotation, mut place, mut velocity) =
            (start.world_from_body.rotation, start.world_from_body.translation, start.velocity);
        let gravity = Vec3::new(0.0, 0.0, -GRAVITY_M_S2);
        // The readings of the source itself, at 200 Hz.
        let packets = all(&small(text));
        let imu: Vec<ImuSample> = packets.iter().flat_map(|p| p.imu.clone()).collect();
        for w in imu.windows(2).take(2000) {
            let dt = w[1].stamp - w[0].stamp;
            let next = rotation * So3::exp(&((w[0].gyro + w[1].gyro) * (0.5 * dt)));
            let acceleration = (rotation * w[0].accel + next * w[1].accel) * 0.5 + gravity;
            place += velocity * dt + acceleration * (0.5 * dt * dt);
            velocity += acceleration * dt;
            rotation = next;
        }
        let end = motion.pose(10.0);
        let (off, angle) = ((place - end.translation).norm(), (rotation.inverse() * end.rotation).angle());
        assert!((place - start.world_from_body.translation).norm() > 2.0, "did not move");
        assert!(off < 0.01, "{text}: {off} m after 10 s");
        assert!(angle < 1e-4, "{text}: {angle} rad after 10 s");
    }
}

#[test]
fn imu_noise_matches_its_densities() {
    let exact = all(&small("sim:demo?sensor=mono-imu&imu_noise=0&duration=4&rate=1"));
    let noisy = all(&small("sim:demo?sensor=mono-imu&duration=4&rate=1"));
    let pairs: Vec<(ImuSample, ImuSample)> = exact
        .iter()
        .zip(&noisy)
        .flat_map(|(a, b)| a.imu.iter().copied().zip(b.imu.iter().copied()))
        .collect();
    let steps: Vec<f64> = pairs
        .windows(2)
        .map(|w| (w[1].1.gyro - w[1].0.gyro) - (w[0].1.gyro - w[0].0.gyro))
        .flat_map(|d| [d.x, d.y, d.z])
        .collect();
    // Differences of white noise have twice its variance.
    let deviation = (steps.iter().map(|v| v * v).sum::<f64>() / steps.len() as f64 / 2.0).sqrt();
    let expected = 1.7e-4 * 200f64.sqrt();
    assert!((deviation / expected - 1.0).abs() < 0.1, "{deviation} for {expected}");
}

#[test]
fn parse_errors_name_the_part() {
    for (text, word) in [
        ("corridor", "sim:"),
        ("sim:moon", "moon"),
        ("sim:hall?seed=x", "seed=x"),
        ("sim:hall?sped=1", "sped"),
        ("sim:hall?rate=-1", "rate=-1"),
        ("sim:hall?rate=NaN", "rate=NaN"),
        ("sim:hall?resolution=0x0", "resolution"),
        ("sim:hall?sensor=sonar", "sonar"),
        ("sim:hall?seed", "\"=\""),
        ("sim:hall?way=nowhere", "nowhere"),
        ("sim:hall?trajectory=/no/such/file", "/no/such/file"),
        ("sim:hall?start=99999", "99999"),
        ("sim:hall?route=across&laps=2", "does not end where it begins"),
        ("sim:hall?laps=0", "laps=0"),
    ] {
        let error = SimSource::open(text).err().unwrap_or_else(|| panic!("{text} was accepted"));
        assert!(error.to_string().contains(word), "{text}: {error}");
    }
}

#[test]
fn a_lap_more_takes_as_long_again() {
    let frames = |text: &str| SimSource::open(text).unwrap().info().frames.unwrap();
    let one = frames("sim:hall?route=loop&rate=2");
    let three = frames("sim:hall?route=loop&laps=3&rate=2");
    assert!((3 * one).abs_diff(three) < 3 * one / 20, "{one} frames a lap, {three} for three");
}

#[test]
fn invalid_configs_are_errors() {
    let spoil: [fn(&mut SimConfig); 9] = [
        |s| s.start_s = -1e300,
        |s| s.rate_hz = f64::NAN,
        |s| s.rate_hz = 1e9,
        |s| s.walker.height = f64::INFINITY,
        |s| s.walker.speed = f64::NAN,
        |s| s.effects.noise = -1.0,
        |s| s.camera.fx = 0.0,
        |s| s.baseline_m = 0.0,
        |s| s.route = CameraPath::Points(vec![cairn_geometry::Vec2::new(f64::NAN, 0.0)]),
    ];
    for (i, spoil) in spoil.iter().enumerate() {
        let mut s = small("sim:hall?rate=20");
        spoil(&mut s);
        assert!(SimSource::new(&s).is_err(), "config {i} was accepted");
    }
    // Two poses a century apart: too many frames, reported at once.
    let far = |t: i64| (Stamp(t * 1_000_000_000), Se3::identity());
    let mut s = small("sim:hall?rate=20");
    s.route = CameraPath::Poses(vec![far(0), far(1), far(3_000_000_000)]);
    assert!(SimSource::new(&s).is_err());
}

#[test]
fn follows_given_poses() {
    let pose = |i: i64| {
        Se3::new(
            So3::exp(&Vec3::new(-1.57, 0.0, 0.0)) * So3::exp(&Vec3::new(0.0, 0.03 * i as f64, 0.0)),
            Vec3::new(8.0 + 0.05 * i as f64, 6.0, 1.4),
        )
    };
    let poses: Vec<(Stamp, Se3)> =
        (0..10).map(|i| (Stamp(5_000_000_000 + 100_000_000 * i), pose(i))).collect();
    let mut s = small("sim:hall?effects=none&rate=10");
    s.route = CameraPath::Poses(poses.clone());
    let source = SimSource::new(&s).unwrap();
    assert_eq!(source.info().truth.len(), 10);
    for ((a, p), (b, q)) in poses.iter().zip(&source.info().truth) {
        assert_eq!(a, b);
        assert!((p.translation - q.translation).norm() < 1e-9);
    }
}

#[test]
fn live_rig_matches_source() {
    let mut s = small("sim:corridor?sensor=stereo&duration=0.4");
    s.effects = Effects::none();
    let mut live = LiveRig::new(&s).unwrap();
    let mut source = SimSource::new(&s).unwrap();
    let truth = source.info().truth.clone();
    for (stamp, pose) in truth {
        let (a, b) = (live.packet(stamp, &pose).unwrap(), source.next_packet().unwrap().unwrap());
        assert_eq!(a.images, b.images);
    }
    assert!(live.packet(Stamp(0), &Se3::identity()).is_err());
    assert_eq!(WorldKind::ALL.len(), 8);
}

/// Writes a motion with its exact readings in the format of recordings, and returns the two files.
fn written_motion(folder: &std::path::Path) -> [String; 2] {
    use std::fmt::Write;
    let source = SimSource::new(&small("sim:hall?sensor=mono-imu&imu_noise=0&duration=4&rate=1")).unwrap();
    let motion = source.motion();
    let (mut poses, mut readings) = (String::new(), String::from("#timestamp [ns],w,a\n"));
    for k in 0..800_i64 {
        let (ns, state) = (7_000_000_000 + 5_000_000 * k, motion.state(k as f64 * 5e-3));
        let (p, q) = (state.world_from_body.translation, state.world_from_body.rotation);
        let force = q.inverse() * (state.acceleration + Vec3::z() * GRAVITY_M_S2);
        let (w, q) = (state.rate, q.quaternion().coords);
        writeln!(
            poses,
            "{}.{:09} {} {} {} {} {} {} {}",
            ns / 1_000_000_000,
            ns % 1_000_000_000,
            p.x,
            p.y,
            p.z,
            q.x,
            q.y,
            q.z,
            q.w
        )
        .unwrap();
        writeln!(readings, "{ns},{},{},{},{},{},{}", w.x, w.y, w.z, force.x, force.y, force.z).unwrap();
    }
    std::fs::create_dir_all(folder).unwrap();
    let files = ["gt.tum", "imu.csv"].map(|f| folder.join(f));
    std::fs::write(&files[0], poses).unwrap();
    std::fs::write(&files[1], readings).unwrap();
    files.map(|f| f.display().to_string())
}

#[test]
fn recorded_motion_keeps_its_readings() {
    let folder = std::env::temp_dir().join(format!("cairn-sim-recorded-{}", std::process::id()));
    let [poses, readings] = written_motion(&folder);
    let address = format!("sim:arena?trajectory={poses}&imu={readings}&sensor=rgbd-imu&duration=1");
    let source = SimSource::new(&small(&address)).unwrap();
    let agreement = source.agreement().unwrap();
    assert!(agreement.turn_rms[1] < 1e-4 && agreement.acceleration_rms[1] < 0.05, "{agreement:?}");
    assert!(agreement.offset_s.abs() < 1e-4 && agreement.moved_m[1] < 2e-3, "{agreement:?}");
    // The room is built for the motion: all of it is inside.
    for (_, pose) in &source.info().truth {
        assert!(source.world().is_free(pose.translation.x, pose.translation.y) && pose.translation.z > 0.6);
    }
    let text = std::fs::read_to_string(&readings).unwrap();
    let in_file: Vec<&str> = text.lines().skip(1).collect();
    let packets = all(&small(&address));
    assert_eq!(packets.len(), 21);
    let given: Vec<ImuSample> = packets.iter().flat_map(|p| p.imu.clone()).collect();
    let first = in_file.iter().position(|l| l.starts_with(&given[0].stamp.0.to_string())).unwrap();
    for (sample, line) in given.iter().zip(&in_file[first..]) {
        assert!(line.starts_with(&format!("{},{}", sample.stamp.0, sample.gyro.x)), "{line}");
    }
    // Off by 20 ms: the sample at or after an image was taken 20 ms later than stamped.
    let late = all(&small(&format!("{address}&imu_offset=20&imu_mean=2")));
    let sample = late[10].imu.last().unwrap();
    assert!(sample.stamp >= late[10].stamp && sample.stamp - late[10].stamp < 0.011);
    let taken = sample.stamp.plus_seconds(0.02);
    let pair = given.iter().filter(|s| (s.stamp - taken).abs() < 3e-3);
    let mean = pair.fold(Vec3::zeros(), |sum, s| sum + s.gyro * 0.5);
    assert!((mean - sample.gyro).norm() < 1e-9, "{mean:?} and {:?}", sample.gyro);
    for (bad, word) in [
        (format!("sim:arena?imu={readings}"), "trajectory"),
        (format!("sim:arena?trajectory={poses}&imu={readings}&sensor=mono"), "sensor"),
        (format!("sim:arena?trajectory={poses}&imu={poses}"), "fields"),
        (format!("sim:arena?trajectory={poses}&imu=/no/such/file"), "/no/such/file"),
        ("sim:arena?size=1x1".into(), "size"),
        ("sim:arena?mount=1,2".into(), "mount"),
    ] {
        let error = SimSource::open(&bad).err().unwrap_or_else(|| panic!("{bad} was taken"));
        assert!(error.to_string().contains(word), "{bad}: {error}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn dead_end_is_blank_at_the_turn() {
    let mut s = small("sim:dead-end?sensor=mono-imu&effects=none&rate=10");
    s.walker.turn_rate = std::f64::consts::PI / 3.0;
    let mut source = SimSource::new(&s).unwrap();
    let truth = source.info().truth.clone();
    let turns: Vec<usize> =
        (0..truth.len()).filter(|i| source.motion().state(*i as f64 * 0.1).rate.norm() > 0.8).collect();
    let seconds = 0.1 * turns.len() as f64;
    assert!((2.0..4.0).contains(&seconds), "turns for {seconds} s");
    let (mut range, mut index) = ((0, 255), 0);
    while let Some(packet) = source.next_packet().unwrap() {
        if index == turns[turns.len() / 2] {
            let pixels = packet.images[0].data();
            range = (*pixels.iter().max().unwrap(), *pixels.iter().min().unwrap());
            let across = truth[index].1.rotation * Vec3::z();
            assert!(across.y.abs() > 0.8, "looks along {across:?}");
        }
        index += 1;
    }
    // One wall under one light: almost no texture.
    assert!(range.0 - range.1 < 60, "grey levels from {} to {}", range.1, range.0);
    let end = truth[truth.len() - 1].1.translation - truth[0].1.translation;
    assert!(end.xy().norm() < 0.1, "comes home to {end:?}");
}
