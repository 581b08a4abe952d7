//! 7-Scenes folders: `frame-NNNNNN.color.*`, `.depth.png`, `.pose.txt`.
//!
//! Shotton et al., "Scene coordinate regression forests" (2013). Kinect images at a nominal 30 Hz without times; depth
//! in millimetres, 65535 for none; the poses are the depth camera's.

use crate::recording::{Instant, Recording};
use crate::rig;
use crate::text::{fields, numbers, read_text};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, DepthSensor, Rig, RigCamera, SourceError, Stamp};
use std::path::{Path, PathBuf};

const RATE_HZ: i64 = 30;
const NO_DEPTH: u16 = 65535;

/// True when a folder looks like one.
pub fn is(folder: &Path) -> bool {
    entries(folder).next().is_some()
}

/// Indexes the folder.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let mut rig = match (given, rig::file_in(folder)) {
        (Some(rig), _) => rig,
        (None, Some(path)) => rig::read_rig(path)?,
        (None, None) => kinect(folder)?,
    };
    rig.cameras.truncate(1);
    rig.imu = None;
    let mut files: Vec<(i64, PathBuf)> = entries(folder).collect();
    files.sort();
    files.dedup_by_key(|(number, _)| *number);
    let first = files.first().map_or(0, |(number, _)| *number);
    let mut instants = Vec::new();
    let mut truth = Vec::new();
    for (number, image) in files {
        let stamp = Stamp(((number - first) * 1_000_000_000 + RATE_HZ / 2) / RATE_HZ);
        let name = image.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let stem = name.split('.').next().unwrap_or_default();
        let depth = folder.join(format!("{stem}.depth.png"));
        // A pose that is missing or not finite (tracking was lost there) is no truth.
        if let Some(pose) = pose(&folder.join(format!("{stem}.pose.txt"))) {
            truth.push((stamp, pose));
        }
        instants.push(Instant { stamp, images: vec![image], depth: depth.is_file().then_some(depth) });
    }
    let name = format!("7-Scenes folder {}", folder.display());
    Ok(Recording { name, rig, instants, imu: None, truth, no_depth: Some(NO_DEPTH), skipped: Vec::new() })
}

/// Numbers and paths of the colour images.
fn entries(folder: &Path) -> impl Iterator<Item = (i64, PathBuf)> {
    std::fs::read_dir(folder).into_iter().flatten().filter_map(|e| {
        let path = e.ok()?.path();
        let name = path.file_name()?.to_str()?;
        let (number, kind) = name.strip_prefix("frame-")?.split_once(".color.")?;
        let number = number.parse().ok().filter(|n| (0..1_000_000_000).contains(n))?;
        matches!(kind, "png" | "jpg" | "jpeg").then_some((number, path))
    })
}

fn pose(path: &Path) -> Option<Se3> {
    let m = numbers::<16>(fields(&read_text(path).ok()?))?;
    rig::rigid(&m, "pose").ok()
}

/// The Kinect of the recordings. The body is the depth camera.
fn kinect(folder: &Path) -> Result<Rig, SourceError> {
    let depth = depth_camera(&folder.join("camera-intrinsics.txt"))?;
    let colour = Camera::pinhole(640, 480, COLOUR_FOCAL, COLOUR_FOCAL, 320.0, 240.0);
    let colour =
        RigCamera { name: "color".into(), camera: colour, body_from_camera: colour_from_depth().inverse() };
    let depth = DepthSensor {
        camera: depth,
        body_from_depth: Se3::identity(),
        metres_per_unit: 0.001,
        registered: false,
    };
    Ok(Rig { cameras: vec![colour], depth: Some(depth), imu: None })
}

/// Where the colour camera sits: `p_colour = colour_from_depth * p_depth`.
///
/// Measured on RedKitchen, without its truth: near pixels of depth steps (over 12 %, under 4 m; 108,000 in 50 frames)
/// were projected into the colour image, and the mean gradient across the step taken there (derivative of Gaussian,
/// 1 px, cut off at 20). Fitting rotation, translation in the plane and focal length reaches 7.06; the rounded numbers below
/// give 7.05. Fitted on the first half of the frames alone it gives 6.50 on the second (6.65 when fitted there), and a
/// radial lens adds less than 1 %. For comparison: both cameras in one place 4.37; the calibration found in the
/// literature (rotation 8.2, -7.9, -2.7 mrad, translation -25.6, 0.1, 2.0 mm) 3.50, its inverse 3.14, its translation
/// alone 5.72: the direction is the one it states, the rotation belongs to another centre or another camera.
fn colour_from_depth() -> Se3 {
    Se3::new(So3::exp(&Vec3::new(0.0047, -0.0012, 0.0074)), Vec3::new(-0.0220, 0.0017, 0.0))
}

/// Focal length of the colour camera, from the same fit.
const COLOUR_FOCAL: f64 = 526.4;

/// The depth camera: the 3x3 matrix in the folder, else the data set's stated 585 px around the middle.
fn depth_camera(path: &Path) -> Result<Camera, SourceError> {
    if !path.is_file() {
        return Ok(Camera::pinhole(640, 480, 585.0, 585.0, 320.0, 240.0));
    }
    let text = read_text(path)?;
    let wrong = |why: String| {
        SourceError::new(
            path.display().to_string(),
            why,
            "write the 3x3 matrix of the depth camera, or delete it",
        )
    };
    let k = numbers::<9>(fields(&text)).ok_or_else(|| wrong("does not hold nine finite numbers".into()))?;
    let camera = Camera::pinhole(640, 480, k[0], k[4], k[2], k[5]);
    camera.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(camera)
}
