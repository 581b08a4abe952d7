//! TUM RGB-D folders: `rgb.txt`, `depth.txt`, `groundtruth.txt`.
//!
//! Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012). Depth is registered to
//! colour; 5000 units are one metre.

use crate::recording::{Instant, QuaternionOrder, Recording, join_depth, read_index, read_truth};
use crate::rig;
use crate::text::stamp_seconds;
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthSensor, Distortion, Rig, SourceError};
use std::path::Path;

/// Largest time between a colour image and its depth image, nanoseconds.
const MAX_APART_NS: u64 = 20_000_000;

/// True when a folder looks like a TUM RGB-D recording.
pub fn is(folder: &Path) -> bool {
    folder.join("rgb.txt").is_file()
}

/// Indexes the folder. Its rig is the one given, a Cairn or Kalibr file in it, or the published calibration
/// of the camera named by the folder (`freiburg1`, `2`, `3`), or else the ROS default.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let mut name = format!("TUM RGB-D folder {}", folder.display());
    let mut assumed = None;
    let mut rig = match (given, rig::file_in(folder)) {
        (Some(rig), _) => rig,
        (None, Some(path)) => {
            let rig = rig::read_rig(&path)?;
            // Kalibr has no depth sensors; depth is registered to the colour camera, whose poses the ground
            // truth gives.
            let own = path.extension().is_some_and(|e| e == "toml");
            if own { rig } else { rgbd(rig.cameras[0].camera) }
        }
        (None, None) => {
            let (camera, which) = published(folder);
            name += &format!(" ({which})");
            assumed = Some(which.to_owned());
            rgbd(camera)
        }
    };
    rig.cameras.truncate(1);
    rig.imu = None;
    let mut skipped = Vec::new();
    let colour = read_index(&folder.join("rgb.txt"), stamp_seconds, folder, &mut skipped)?;
    let depth_file = folder.join("depth.txt");
    let depth = match rig.depth.is_some() && depth_file.is_file() {
        true => read_index(&depth_file, stamp_seconds, folder, &mut skipped)?,
        false => Vec::new(),
    };
    if depth.is_empty() {
        rig.depth = None;
    }
    let truth_file = folder.join("groundtruth.txt");
    let truth = match truth_file.is_file() {
        true => read_truth(&truth_file, stamp_seconds, QuaternionOrder::WLast)?,
        false => Vec::new(),
    };
    let mut instants: Vec<Instant> = colour
        .into_iter()
        .map(|(stamp, image)| Instant { stamp, images: vec![image], depth: None })
        .collect();
    join_depth(&mut instants, depth, MAX_APART_NS);
    Ok(Recording { name, rig, instants, imu: None, bag: None, truth, no_depth: None, skipped, assumed })
}

fn rgbd(camera: Camera) -> Rig {
    let depth = DepthSensor {
        camera,
        body_from_depth: Se3::identity(),
        metres_per_unit: 1.0 / 5000.0,
        registered: true,
    };
    Rig { depth: Some(depth), ..Rig::mono(camera) }
}

/// The data set's published colour calibrations, by the name of the folder.
fn published(folder: &Path) -> (Camera, &'static str) {
    let name = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
    let name = name.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let with = |[fx, fy, cx, cy]: [f64; 4], distortion| Camera {
        distortion,
        ..Camera::pinhole(640, 480, fx, fy, cx, cy)
    };
    let brown = Distortion::RadialTangential;
    if name.contains("freiburg1") || name.starts_with("fr1") {
        let lens = brown([0.2624, -0.9531, -0.0054, 0.0026, 1.1633]);
        (with([517.3, 516.5, 318.6, 255.3], lens), "published intrinsics of freiburg1")
    } else if name.contains("freiburg2") || name.starts_with("fr2") {
        let lens = brown([0.2312, -0.7849, -0.0033, -0.0001, 0.9172]);
        (with([520.9, 521.0, 325.1, 249.7], lens), "published intrinsics of freiburg2")
    } else if name.contains("freiburg3") || name.starts_with("fr3") {
        (with([535.4, 539.2, 320.1, 247.6], Distortion::None), "published intrinsics of freiburg3")
    } else {
        let which = "no intrinsics given: ROS default fx = fy = 525, centre (319.5, 239.5)";
        (with([525.0, 525.0, 319.5, 239.5], Distortion::None), which)
    }
}
