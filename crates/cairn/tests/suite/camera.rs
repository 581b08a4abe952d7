//! SLAM on a camera that is plugged in: the frames of a recording through the simulated devices of a D435i.

#![cfg(all(target_os = "linux", target_pointer_width = "64"))]

use crate::recordings::recording;
use cairn::geometry::{Se3, So3, Vec3};
use cairn::sensor::{Camera, DepthSensor, Rig};
use cairn::sources::camera::{CameraAddress, CameraSource, Simulated};
use cairn::sources::{OpenOptions, open};
use cairn::{Slam, Source};
use std::sync::Arc;

/// Frames of the recording that are played, and how many a second: SLAM keeps up on a machine that is busy with other tests.
const FRAMES: usize = 150;
const RATE_HZ: f64 = 15.0;

#[test]
fn the_map_of_a_live_depth_camera_is_as_accurate_as_that_of_the_recording() {
    let Some(folder) = recording("7scenes-kitchen") else { return };
    let mut recorded =
        open(folder.to_str().unwrap(), OpenOptions { frames: Some(FRAMES), ..Default::default() }).unwrap();
    let mut slam = Slam::for_source(&*recorded).build().unwrap();
    let mut packets = Vec::new();
    while let Some(packet) = recorded.next_packet().unwrap() {
        slam.track(&packet).unwrap();
        packets.push(packet);
    }
    slam.finish();
    let truth = recorded.info().truth.clone();
    let of_recording = slam.accuracy(&truth).unwrap().ate_m.rmse;

    // The device: depth 15 mm beside the colour camera, turned and of a shorter focal length.
    let first = recorded.rig().cameras[0].clone();
    let (w, h, c) = (first.camera.width, first.camera.height, first.camera);
    let depth = DepthSensor {
        camera: Camera::pinhole(w, h, 0.9 * c.fx, 0.9 * c.fy, c.cx + 2.0, c.cy - 2.0),
        body_from_depth: first.body_from_camera
            * Se3::new(So3::exp(&Vec3::new(0.002, -0.004, 0.003)), Vec3::new(-0.015, 0.0, 0.0)),
        metres_per_unit: recorded.rig().depth.as_ref().unwrap().metres_per_unit,
        registered: false,
    };
    let rig = Rig { cameras: vec![first], depth: Some(depth), imu: None };
    let machine = Simulated::replay(&rig, &packets, RATE_HZ);
    let address = CameraAddress::of(&format!("realsense:?rate={RATE_HZ}")).unwrap().unwrap();
    let options = OpenOptions { rig: Some(rig), ..Default::default() };
    let mut source = CameraSource::open(Arc::new(machine), &address, &options).unwrap();
    let mut slam = Slam::for_source(&source).build().unwrap();
    let (mut live_truth, mut decode_ms, mut last) = (Vec::new(), Vec::new(), 0);
    while last + 5 < FRAMES {
        let packet = source.next_packet().unwrap().unwrap();
        // Which one it is: live pictures have times of their own.
        last = packets.iter().position(|p| p.images[0].data() == packet.images[0].data()).unwrap();
        let at = packets[last].stamp;
        if let Some((_, pose)) = truth.iter().find(|(stamp, _)| *stamp == at) {
            live_truth.push((packet.stamp, *pose));
        }
        decode_ms.push(packet.decode_ms);
        slam.track(&packet).unwrap();
    }
    slam.finish();
    let live = slam.accuracy(&live_truth).unwrap();
    decode_ms.sort_by(f64::total_cmp);
    println!(
        "recording: ATE {of_recording:.4} m; live: ATE {:.4} m over {:.2} m, {} of {FRAMES} frames, decoded and aligned in \
         {:.1} ms (median)",
        live.ate_m.rmse,
        live.path_m,
        decode_ms.len(),
        decode_ms[decode_ms.len() / 2]
    );
    assert!(decode_ms.len() > FRAMES / 2, "{} frames", decode_ms.len());
    assert!(live.pairs >= decode_ms.len() * 9 / 10, "{} poses", live.pairs);
    // Depth was moved twice, to the sensor's place and back, and some frames were overtaken.
    assert!(live.ate_m.rmse < of_recording + 0.01, "{} m", live.ate_m.rmse);
}
