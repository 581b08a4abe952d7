//! Contract of the front end: accepted and rejected input, and deterministic output.

use crate::common;

use cairn_geometry::{Se3, So3, Vec2, Vec3};
use cairn_sensor::{Camera, DepthImage, DepthSensor, FramePacket, GrayImage, Rig, Stamp};
use cairn_vision::{Frame, FrontEnd, FrontEndConfig, FrontEndError, SensorMode};
use common::scene::{Exposure, Scene, lens_pair};
use std::sync::Arc;

const EXPOSURE: Exposure = Exposure { gain: 1.0, offset: 0.0, noise: 2.0, seed: 3 };

fn packet(images: Vec<GrayImage>, depth: Option<DepthImage>) -> FramePacket {
    FramePacket {
        stamp: Stamp(42),
        images: images.into_iter().map(Arc::new).collect(),
        depth: depth.map(Arc::new),
        imu: Vec::new(),
        decode_ms: 0.0,
    }
}

/// A colour camera with distortion and a depth camera 25 mm beside it, slightly rotated, with another focal length.
fn rgbd_rig(registered: bool) -> Rig {
    let mut rig = Rig::mono(lens_pair().cameras[0].camera);
    let (camera, body_from_depth) = if registered {
        (rig.cameras[0].camera, Se3::identity())
    } else {
        let turn = So3::exp(&Vec3::new(0.01, -0.02, 0.005));
        (
            Camera::pinhole(640, 480, 420.0, 420.0, 318.0, 241.0),
            Se3::new(turn, Vec3::new(0.025, 0.001, -0.002)),
        )
    };
    rig.depth = Some(DepthSensor { camera, body_from_depth, metres_per_unit: 0.001, registered });
    rig
}

/// The scene's exact depth in millimetres, with holes without measurement.
fn depth_image(scene: &Scene, sensor: &DepthSensor) -> DepthImage {
    let c = &sensor.camera;
    let mut image = DepthImage::new(c.width, c.height);
    for y in 0..c.height {
        for x in 0..c.width {
            let hole = (x / 16 + y / 16) % 5 == 0;
            let z = scene.depth(c, &sensor.body_from_depth, [x as f32, y as f32]);
            image.row_mut(y)[x] = if hole { 0 } else { z.map_or(0, |z| (z * 1000.0).round() as u16) };
        }
    }
    image
}

fn same(a: &Frame, b: &Frame) -> bool {
    let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    a.px == b.px
        && a.raw == b.raw
        && a.octave == b.octave
        && a.descriptors == b.descriptors
        && bits(&a.angle) == bits(&b.angle)
        && bits(&a.right_x) == bits(&b.right_x)
        && bits(&a.depth) == bits(&b.depth)
}

#[test]
fn two_threads_give_the_same_frame() {
    let rig = lens_pair();
    let scene = Scene::room(5);
    let right = rig.cameras[0].body_from_camera.inverse() * rig.cameras[1].body_from_camera;
    let images = vec![
        scene.render(&rig.cameras[0].camera, &Se3::identity(), &EXPOSURE),
        scene.render(&rig.cameras[1].camera, &right, &EXPOSURE),
    ];
    let packet = packet(images, None);
    let extract = |two_threads| {
        let config = FrontEndConfig { two_threads, ..FrontEndConfig::default() };
        let mut front_end = FrontEnd::new(&rig, SensorMode::Stereo, config).unwrap();
        let first = front_end.extract(&packet).unwrap();
        assert!(same(&first, &front_end.extract(&packet).unwrap()), "the second frame of one packet differs");
        first
    };
    let frame = extract(true);
    assert!(same(&frame, &extract(false)));
    assert_eq!(frame.stamp, Stamp(42));
    assert!(frame.len() > 900);
    assert!(frame.depth.iter().filter(|d| **d > 0.0).count() > 400);
}

#[test]
fn mono_frame_is_undistorted_without_depth() {
    let rig = Rig::mono(lens_pair().cameras[0].camera);
    let mut front_end = FrontEnd::new(&rig, SensorMode::Mono, FrontEndConfig::default()).unwrap();
    let image = Scene::room(6).render(&rig.cameras[0].camera, &Se3::identity(), &EXPOSURE);
    let frame = front_end.extract(&packet(vec![image], None)).unwrap();
    assert!(frame.len() > 900);
    for i in 0..frame.len() {
        let [u, v] = frame.raw[i];
        let b = rig.cameras[0].camera.unproject(&Vec2::new(u as f64, v as f64)).unwrap();
        let [x, y, _] = front_end.model().project(&b).unwrap();
        assert!((x - frame.px[i][0] as f64).abs() < 0.01 && (y - frame.px[i][1] as f64).abs() < 0.01);
        assert!(frame.depth[i].is_nan() && frame.right_x[i].is_nan() && !frame.has_depth(i));
        assert!(front_end.model().contains(x, y));
    }
    let mut near = Vec::new();
    frame.near(frame.px[0][0], frame.px[0][1], 3.0, |i| near.push(i));
    assert!(near.contains(&0));
}

#[test]
fn rgbd_depth_matches_the_scene() {
    for registered in [true, false] {
        let rig = rgbd_rig(registered);
        let scene = Scene::room(7);
        let sensor = rig.depth.as_ref().unwrap();
        let image = scene.render(&rig.cameras[0].camera, &Se3::identity(), &EXPOSURE);
        let depth = depth_image(&scene, sensor);
        let mut front_end = FrontEnd::new(&rig, SensorMode::Rgbd, FrontEndConfig::default()).unwrap();
        let frame = front_end.extract(&packet(vec![image.clone()], Some(depth))).unwrap();
        let (mut n, mut wrong, mut sum) = (0, 0, 0.0);
        for i in (0..frame.len()).filter(|&i| frame.has_depth(i)) {
            let truth = scene.depth(&rig.cameras[0].camera, &Se3::identity(), frame.raw[i]).unwrap();
            let error = (frame.depth[i] as f64 - truth).abs();
            n += 1;
            if error > 0.02 * truth {
                wrong += 1;
            } else {
                sum += error / truth;
            }
            let disparity = (frame.px[i][0] - frame.right_x[i]) as f64;
            assert!((disparity * frame.depth[i] as f64 / front_end.model().baseline_fx - 1.0).abs() < 1e-2);
        }
        println!(
            "registered {registered}: {n} of {} features have depth, {wrong} wrong by over 2 %, mean error of \
             the others {:.5} of the depth",
            frame.len(),
            sum / (n - wrong) as f64
        );
        // A fifth of the depth image is holes, and many corners lie on depth edges.
        assert!(n as f64 > 0.45 * frame.len() as f64);
        assert!((wrong as f64) < 0.01 * n as f64);
        assert!(sum / ((n - wrong) as f64) < 0.001);

        let without = front_end.extract(&packet(vec![image], None)).unwrap();
        assert_eq!(without.len(), frame.len());
        assert!(without.depth.iter().all(|d| d.is_nan()) && without.right_x.len() == without.len());
    }
}

#[test]
fn invalid_packets_and_rigs_are_errors() {
    let rig = lens_pair();
    let config = FrontEndConfig::default();
    let mut front_end = FrontEnd::new(&rig, SensorMode::Stereo, config).unwrap();
    let good = || GrayImage::new(752, 480);
    assert_eq!(
        front_end.extract(&packet(vec![good()], None)).unwrap_err(),
        FrontEndError::MissingImage { have: 1, need: 2 }
    );
    assert!(front_end.extract(&packet(vec![], None)).is_err());
    let error = front_end.extract(&packet(vec![good(), GrayImage::new(640, 480)], None)).unwrap_err();
    assert_eq!(error.to_string(), "cam1: the image is [640, 480] pixels, its calibration is for [752, 480]");
    // Black images are accepted and have no features.
    assert!(front_end.extract(&packet(vec![good(), good()], None)).unwrap().is_empty());

    let mut front_end = FrontEnd::new(&rgbd_rig(true), SensorMode::Rgbd, config).unwrap();
    assert!(matches!(
        front_end.extract(&packet(vec![good()], Some(DepthImage::new(0, 0)))),
        Err(FrontEndError::WrongSize { .. })
    ));

    let mono = Rig::mono(rig.cameras[0].camera);
    assert!(FrontEnd::new(&mono, SensorMode::Stereo, config).unwrap_err().0.contains("two cameras"));
    assert!(FrontEnd::new(&mono, SensorMode::Rgbd, config).unwrap_err().0.contains("no depth sensor"));
    let mut broken = mono.clone();
    broken.cameras[0].camera.fx = f64::NAN;
    assert!(FrontEnd::new(&broken, SensorMode::Mono, config).is_err());
    let none = Rig { cameras: vec![], depth: None, imu: None };
    assert!(FrontEnd::new(&none, SensorMode::Mono, config).is_err());
}

#[test]
fn tiny_images_and_extreme_configs_are_handled() {
    let rig = Rig::mono(Camera::pinhole(8, 5, 10.0, 10.0, 4.0, 2.0));
    let mut config = FrontEndConfig::default();
    config.orb.features = 0;
    config.orb.levels = 0;
    let mut front_end = FrontEnd::new(&rig, SensorMode::Mono, config).unwrap();
    assert!(front_end.extract(&packet(vec![GrayImage::new(8, 5)], None)).unwrap().is_empty());
}
