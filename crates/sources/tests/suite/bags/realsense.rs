//! Recordings of the SDK of RealSense cameras.

use super::written::{Info, Message, Temporary, camera_info, float32, image, imu, rosbag1, transform};
use super::{SIZE, STEP, T0, gray, info, play};
use cairn_geometry::Vec3;
use cairn_sensor::Distortion;
use cairn_sources::OpenOptions;

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
