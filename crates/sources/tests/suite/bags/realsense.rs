//! Recordings of the SDK of RealSense cameras.

use super::written::{Info, Message, Temporary, camera_info, float32, image, imu, rosbag1, transform};
use super::{SIZE, STEP, T0, gray, info, play, play_path};
use cairn_geometry::Vec3;
use cairn_sensor::Distortion;
use cairn_sources::OpenOptions;

fn recorded(name: &str) -> String {
    format!("{}/tests/data/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// A recording in the layout that the RealSense SDK documents: colour with inverse Brown-Conrady, depth apart from it with a
/// unit of its own, gyroscope and accelerometer at their own rates, extrinsics from one reference.
fn realsense() -> Vec<Message> {
    let s = "/device_0/sensor_0/Depth_0";
    let c = "/device_0/sensor_1/Color_0";
    let (g, a) = ("/device_0/sensor_2/Gyro_0", "/device_0/sensor_2/Accel_0");
    let coefficients = [0.12, -0.25, 0.0005, -0.0007, 0.08];
    let colour = Info {
        model: "Inverse Brown Conrady",
        d: &coefficients,
        r: [0.0; 9],
        p: [0.0; 12],
        ..info("0", 0.0)
    };
    let depth = Info { model: "Brown Conrady", r: [0.0; 9], p: [0.0; 12], ..info("0", 0.0) };
    let mut out = vec![
        camera_info(true, &format!("{s}/info/camera_info"), 1, &depth),
        camera_info(true, &format!("{c}/info/camera_info"), 1, &colour),
        float32("/device_0/sensor_0/option/Depth Units/value", 1, 0.0001),
        transform(&format!("{s}/tf/0"), 1, [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        // p_colour = p_reference + t: the colour camera is 15 mm to the left of depth.
        transform(&format!("{c}/tf/0"), 1, [0.015, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        transform(&format!("{g}/tf/0"), 1, [0.005, -0.01, 0.0, 0.0, 0.0, 0.0, 1.0]),
        transform(&format!("{a}/tf/0"), 1, [0.005, -0.01, 0.0, 0.0, 0.0, 0.0, 1.0]),
    ];
    let units: Vec<u8> = (0..32 * 24).flat_map(|_| 15_000u16.to_le_bytes()).collect();
    for i in 0..6 {
        let ns = T0 + i * STEP;
        out.push(image(true, &format!("{c}/image/data"), ns, "0", SIZE, "rgb8", &[50; 3 * 32 * 24]));
        out.push(image(true, &format!("{s}/image/data"), ns + 3_000_000, "0", SIZE, "mono16", &units));
    }
    for i in 0..80 {
        let ns = T0 - 15_000_000 + i * 5_000_000;
        out.push(imu(true, &format!("{g}/imu/data"), ns, "0", [0.0, 0.0, i as f64], [0.0; 3]));
    }
    for i in 0..30 {
        let ns = T0 - 20_000_000 + i * 16_000_000;
        out.push(imu(
            true,
            &format!("{a}/imu/data"),
            ns,
            "0",
            [0.0; 3],
            [0.0, -9.81, (ns - T0) as f64 * 1e-9],
        ));
    }
    out.sort_by_key(|m| m.log_ns);
    out
}

#[test]
fn a_realsense_recording_in_the_documented_layout() {
    let file = Temporary::new("realsense.bag", &rosbag1(&realsense(), "lz4", 30));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert_eq!(packets.len(), 6, "{:?}", source.skipped());
    let rig = source.rig();
    let coefficients = [0.12, -0.25, 0.0005, -0.0007, 0.08];
    assert_eq!(rig.cameras[0].camera.distortion, Distortion::InverseRadialTangential(coefficients));
    let depth = rig.depth.as_ref().unwrap();
    assert!(!depth.registered && depth.metres_per_unit == 0.0001, "{depth:?}");
    // The body is the gyroscope: p_gyro = p_reference + (5, -10, 0) mm.
    let near = |a: Vec3, b: Vec3| assert!((a - b).norm() < 1e-12, "{a} instead of {b}");
    near(depth.body_from_depth.translation, Vec3::new(0.005, -0.01, 0.0));
    near(rig.cameras[0].body_from_camera.translation, Vec3::new(-0.01, -0.01, 0.0));
    assert_eq!(rig.imu.as_ref().unwrap().rate_hz, 200.0);
    assert!(packets.iter().all(|p| p.depth.as_ref().is_some_and(|d| d.at(1, 1) == 15_000)));
    // The accelerometer's ramp, read at the times of the gyroscope.
    let samples: Vec<_> = packets.iter().flat_map(|p| &p.imu).collect();
    assert!(samples.len() > 50);
    for sample in samples {
        let t = (sample.stamp.0 - T0) as f64 * 1e-9;
        assert!((sample.accel.z - t).abs() < 1e-9 && sample.accel.y == -9.81, "{sample:?}");
    }
}

/// Without colour and depth the infrared pair is used, placed by the recorded extrinsics.
#[test]
fn a_realsense_infrared_pair() {
    let mut messages = Vec::new();
    for (i, x) in [(1, 0.0), (2, -0.05)] {
        let s = format!("/device_0/sensor_0/Infrared_{i}");
        let plain = Info { model: "Brown Conrady", r: [0.0; 9], p: [0.0; 12], ..info("0", 0.0) };
        messages.push(camera_info(true, &format!("{s}/info/camera_info"), 1, &plain));
        messages.push(transform(&format!("{s}/tf/0"), 1, [x, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
        (0..4).for_each(|j| messages.push(gray(true, &format!("{s}/image/data"), T0 + j * STEP, "0", 5)));
    }
    messages.push(float32("/device_0/sensor_0/option/Emitter_Enabled/value", 1, 1.0));
    messages.sort_by_key(|m| m.log_ns);
    let file = Temporary::new("infrared.bag", &rosbag1(&messages, "none", 30));
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    assert_eq!((packets.len(), source.rig().cameras.len()), (4, 2));
    let baseline = source.rig().cameras[1].body_from_camera.translation;
    assert!((baseline - Vec3::new(0.05, 0.0, 0.0)).norm() < 1e-12, "{baseline}");
    assert!(source.skipped().iter().any(|s| s.contains("projector was on")), "{:?}", source.skipped());
}

const COEFFICIENTS: [f64; 5] = [0.12, -0.25, 0.0005, -0.0007, 0.08];

/// What three versions of the SDK recorded of one software device (`tools/record_realsense.py`): rosbag1, SQLite with messages
/// that are zstd frames, SQLite with PNG images and a `camera_info` of ROS that calls the lens `plumb_bob`.
#[test]
fn recordings_of_the_sdk_2_57_to_2_59_say_the_same() {
    for name in ["realsense-2.57.bag", "realsense-2.58.db3", "realsense-2.59.db3"] {
        let (source, packets) = play_path(&recorded(name), OpenOptions::default()).unwrap();
        assert!(source.skipped().is_empty(), "{name}: {:?}", source.skipped());
        let rig = source.rig();
        let colour = &rig.cameras[0].camera;
        let Distortion::InverseRadialTangential(c) = colour.distortion else {
            panic!("{name}: the lens is {:?}", colour.distortion)
        };
        assert!(c.iter().zip(COEFFICIENTS).all(|(a, b)| (a - b).abs() < 1e-7), "{name}: {c:?}");
        assert_eq!([colour.fx, colour.fy, colour.cx, colour.cy], [15.0, 15.5, 7.5, 5.5], "{name}");
        let depth = rig.depth.as_ref().unwrap();
        assert_eq!((depth.metres_per_unit, depth.registered), (0.0001, false), "{name}");
        // p_colour = R p_depth + t with R of 36.87 degrees about z, p_gyro = p_depth + (5, -10, 0) mm; the body is the gyroscope.
        let colour_from_depth = rig.cameras[0].body_from_camera.inverse() * depth.body_from_depth;
        let p = colour_from_depth * Vec3::new(1.0, 0.0, 2.0);
        assert!((p - Vec3::new(0.815, 0.602, 1.997)).norm() < 3e-6, "{name}: {p}");
        assert!((depth.body_from_depth.translation - Vec3::new(0.005, -0.01, 0.0)).norm() < 2e-6, "{name}");
        // The device's clock began 100 s before, the host's anew.
        assert_eq!(
            packets.iter().map(|p| p.stamp.0).collect::<Vec<_>>(),
            [T0, T0 + STEP, T0 + 2 * STEP],
            "{name}"
        );
        for (i, packet) in packets.iter().enumerate() {
            let (image, depth) = (&packet.images[0], packet.depth.as_ref().unwrap());
            let luminance = 0.299 * 40.0 + 0.587 * (90 + i) as f64 + 0.114 * 200.0;
            assert!((f64::from(image.at(8, 6)) - luminance).abs() < 1.0, "{name}: {}", image.at(8, 6));
            assert_eq!(depth.at(8, 6), 15_000, "{name}");
        }
        assert_eq!(rig.imu.as_ref().unwrap().rate_hz, 100.0, "{name}");
        let samples: Vec<_> = packets.iter().flat_map(|p| &p.imu).collect();
        assert!(samples.len() >= 11, "{name}: {} samples", samples.len());
        for sample in samples {
            // The gyroscope counts every 10 ms from -15 ms, the accelerometer is a ramp over time.
            let t = (sample.stamp.0 - T0) as f64 * 1e-9;
            assert!((sample.gyro.z - (t + 0.015) / 0.01).abs() < 1e-6, "{name}: {sample:?}");
            assert!(
                (sample.accel.z - t).abs() < 1e-6 && (sample.accel.y + 9.81).abs() < 1e-6,
                "{name}: {sample:?}"
            );
        }
    }
}

/// A recorded file with every occurrence of a text replaced by another of the same length.
fn changed(name: &str, from: &str, to: &str) -> Temporary {
    let mut bytes = std::fs::read(recorded(name)).unwrap();
    let places: Vec<usize> = (0..bytes.len()).filter(|i| bytes[*i..].starts_with(from.as_bytes())).collect();
    assert!(!places.is_empty() && from.len() == to.len(), "{from}");
    places.iter().for_each(|at| bytes[*at..at + to.len()].copy_from_slice(to.as_bytes()));
    Temporary::new(name, &bytes)
}

#[test]
fn a_depth_unit_that_nobody_states_is_refused() {
    let file = changed("realsense-2.59.db3", "option/Depth_Units", "option/Depth_Unity");
    let (source, _) = play(&file, OpenOptions::default()).unwrap();
    assert_eq!(
        source.rig().depth.as_ref().unwrap().metres_per_unit,
        0.0001,
        "each depth image states it too"
    );
    let without: Vec<Message> =
        realsense().into_iter().filter(|m| !m.topic.contains("Depth Units")).collect();
    let file = Temporary::new("no-unit.bag", &rosbag1(&without, "lz4", 30));
    let why = play(&file, OpenOptions::default()).err().unwrap().to_string();
    assert!(
        why.contains("/Depth_0") && why.contains("is not recorded") && why.contains("metres_per_unit"),
        "{why}"
    );
    let mut changing = realsense();
    changing.push(float32("/device_0/sensor_0/option/Depth Units/value", T0 + STEP, 0.001));
    let file = Temporary::new("two-units.bag", &rosbag1(&changing, "lz4", 30));
    let why = play(&file, OpenOptions::default()).err().unwrap().to_string();
    assert!(why.contains("changes from 0.0001 m to 0.001 m"), "{why}");
}

#[test]
fn a_rig_with_another_depth_unit_than_the_recording_is_refused() {
    let (source, _) = play_path(&recorded("realsense-2.59.db3"), OpenOptions::default()).unwrap();
    let with = |metres_per_unit: f64| {
        let mut rig = source.rig().clone();
        rig.depth.as_mut().unwrap().metres_per_unit = metres_per_unit;
        let options = OpenOptions { rig: Some(rig), ..OpenOptions::default() };
        play_path(&recorded("realsense-2.59.db3"), options).map(|(_, packets)| packets.len())
    };
    assert_eq!(with(0.000102).unwrap(), 3, "a corrected scale is one");
    let why = with(0.001).unwrap_err().to_string();
    assert!(
        why.contains("0.0001 m, the rig says 0.001 m") && why.contains("metres_per_unit = 0.0001"),
        "{why}"
    );
}

/// Clocks that cannot be compared: the host's, of arrival, is used for all streams and named.
#[test]
fn streams_with_different_clocks_are_stamped_by_arrival() {
    let text = "timestamp_domain=Hardware Clock;system_time=0.000000;timestamp=100050.000000";
    let other = "timestamp_domain=System Time   ;system_time=0.000000;timestamp=100050.000000";
    let file = changed("realsense-2.59.db3", text, other);
    let (source, packets) = play(&file, OpenOptions::default()).unwrap();
    let skipped = source.skipped();
    assert!(
        skipped.iter().any(|s| s.contains("Hardware Clock, System Time") && s.contains("arrival")),
        "{skipped:?}"
    );
    assert!(packets.iter().all(|p| p.stamp.0 < 10_000_000_000), "{:?}", packets.first().map(|p| p.stamp));
}

/// Not read as another, and not by the `plumb_bob` of the topic beside it.
#[test]
fn a_lens_that_is_not_known_is_refused() {
    let file = changed("realsense-2.59.db3", "model=Inverse Brown Conrady", "model=Reverse Brown Conrady");
    let why = play(&file, OpenOptions::default()).err().unwrap().to_string();
    assert!(why.contains("\"Reverse Brown Conrady\" is not known"), "{why}");
}
