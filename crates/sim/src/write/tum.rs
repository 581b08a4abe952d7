//! The TUM RGB-D layout: `rgb/*.png`, `depth/*.png` (5000 units a metre), `rgb.txt`, `depth.txt`, `groundtruth.txt`,
//! `accelerometer.txt`; and `camchain.yaml` (Kalibr) with the camera's numbers, which the layout itself has no place
//! for.
//!
//! Source: Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012), and its file formats.

use super::folder::Folder;
use cairn_sensor::{DepthImage, Source, SourceError};
use std::fmt::Write;
use std::path::Path;

/// Units a metre in the depth images of this layout.
const UNITS_PER_M: f64 = 5000.0;

/// Writes the rest of an RGB-D source and returns how many frames it had. The ground truth is that of the first camera,
/// as in the data set.
///
/// # Errors
/// When the target is not empty, the source fails or has no registered depth, or writing fails; then nothing is
/// left behind.
pub fn write_tum(target: &Path, source: &mut dyn Source) -> Result<usize, SourceError> {
    let rig = source.rig().clone();
    let Some((depth_sensor, camera)) = rig.depth.as_ref().filter(|d| d.registered).zip(rig.cameras.first())
    else {
        let why = "the TUM layout needs depth registered to the camera";
        return Err(SourceError::new(&source.info().name, why, "write the EuRoC layout, or simulate rgbd"));
    };
    let folder = Folder::begin(target)?;
    folder.folder("rgb")?;
    folder.folder("depth")?;
    let name = source.info().name.clone();
    let head = |what: &str, columns: &str| format!("# {what}\n# {name}\n# {columns}\n");
    let mut rgb = head("color images", "timestamp filename");
    let mut depths = head("depth maps", "timestamp filename");
    let mut accel = head("accelerometer data", "timestamp ax ay az");
    let scale = depth_sensor.metres_per_unit * UNITS_PER_M;
    let mut frames = 0;
    while let Some(packet) = source.next_packet()? {
        let t = packet.stamp;
        if let Some(image) = packet.images.first() {
            folder.gray(&format!("rgb/{t}.png"), image)?;
            let _ = writeln!(rgb, "{t} rgb/{t}.png");
        }
        if let Some(depth) = &packet.depth {
            folder.depth(&format!("depth/{t}.png"), &scaled(depth, scale))?;
            let _ = writeln!(depths, "{t} depth/{t}.png");
        }
        for s in &packet.imu {
            let _ = writeln!(accel, "{} {} {} {}", s.stamp, s.accel.x, s.accel.y, s.accel.z);
        }
        frames += 1;
    }
    folder.text("rgb.txt", &rgb)?;
    folder.text("depth.txt", &depths)?;
    if rig.imu.is_some() {
        folder.text("accelerometer.txt", &accel)?;
    }
    if !source.info().truth.is_empty() {
        let mut truth = head("ground truth trajectory", "timestamp tx ty tz qx qy qz qw");
        for (stamp, pose) in &source.info().truth {
            let pose = *pose * camera.body_from_camera;
            let (p, q) = (pose.translation, pose.rotation.quaternion());
            let _ = writeln!(truth, "{stamp} {} {} {} {} {} {} {}", p.x, p.y, p.z, q.i, q.j, q.k, q.w);
        }
        folder.text("groundtruth.txt", &truth)?;
    }
    let c = &camera.camera;
    let coefficients = super::radial_tangential(&camera.name, c)?;
    let chain = format!(
        "cam0:\n  camera_model: pinhole\n  intrinsics: [{:?}, {:?}, {:?}, {:?}]\n  distortion_model: radtan\n  distortion_coeffs: {coefficients:?}\n  resolution: [{}, {}]\n  rostopic: /cam0/image_raw\n",
        c.fx, c.fy, c.cx, c.cy, c.width, c.height
    );
    folder.text("camchain.yaml", &chain)?;
    folder.finish()?;
    Ok(frames)
}

/// Depth in other units; values out of range become 0.
fn scaled(depth: &DepthImage, scale: f64) -> DepthImage {
    let mut out = depth.clone();
    for d in out.data_mut() {
        let v = (f64::from(*d) * scale).round();
        *d = if v < 65536.0 { v as u16 } else { 0 };
    }
    out
}
