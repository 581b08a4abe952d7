//! TUM RGB-D folders: `rgb.txt`, `depth.txt`, `groundtruth.txt`; or an associations file in place of the first two.
//!
//! Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems" (2012). Depth is registered to
//! colour; 5000 units are one metre.

use crate::recording::{ImageAt, Instant, Recording, join_depth, read_index, read_truth};
use crate::rig;
use crate::text::{data_lines, fields, place, read_text, stamp_seconds};
use cairn_eval::Format;
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthSensor, Distortion, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::{Path, PathBuf};

/// Largest time between a colour image and its depth image, nanoseconds.
const MAX_APART_NS: u64 = 20_000_000;

/// True when a folder looks like a TUM RGB-D recording.
pub fn is(folder: &Path) -> bool {
    folder.join("rgb.txt").is_file() || associations(folder).is_some()
}

/// A file of lines `t colour t depth`, as `associate.py` of the benchmark writes it and ORB-SLAM reads it.
fn associations(folder: &Path) -> Option<PathBuf> {
    const NAMES: [&str; 5] =
        ["associations.txt", "association.txt", "associated.txt", "associate.txt", "assoc.txt"];
    NAMES.iter().map(|name| folder.join(name)).find(|path| path.is_file())
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
    let (colour, mut depth) = match (folder.join("rgb.txt"), associations(folder)) {
        (list, Some(pairs)) if !list.is_file() => read_pairs(&pairs, folder, &mut skipped)?,
        (list, _) => {
            let depth_file = folder.join("depth.txt");
            let depth = match rig.depth.is_some() && depth_file.is_file() {
                true => read_index(&depth_file, stamp_seconds, folder, &mut skipped)?,
                false => Vec::new(),
            };
            (read_index(&list, stamp_seconds, folder, &mut skipped)?, depth)
        }
    };
    if rig.depth.is_none() {
        depth.clear();
    }
    if depth.is_empty() {
        rig.depth = None;
    }
    let truth_file = folder.join("groundtruth.txt");
    let truth = match truth_file.is_file() {
        true => read_truth(&truth_file, Format::Tum)?,
        false => Vec::new(),
    };
    let mut instants: Vec<Instant> = colour
        .into_iter()
        .map(|(stamp, image)| Instant { stamp, images: vec![image], depth: None })
        .collect();
    join_depth(&mut instants, depth, MAX_APART_NS);
    Ok(Recording { name, rig, instants, imu: None, bag: None, truth, no_depth: None, skipped, assumed })
}

type Files = Vec<(Stamp, ImageAt)>;

/// Colour and depth images of an associations file, whichever of the two comes first in a line.
fn read_pairs(path: &Path, folder: &Path, skipped: &mut Vec<Skipped>) -> Result<(Files, Files), SourceError> {
    let text = read_text(path)?;
    let (mut colour, mut depth) = (Vec::new(), Vec::new());
    for (number, line) in data_lines(&text) {
        let mut from = fields(line);
        let mut one = || Some((stamp_seconds(from.next()?)?, folder.join(from.next()?)));
        let Some((first, second)) = one().zip(one()) else {
            let why = "not two time stamps, each with a file";
            let text = format!("{}: {why}, line left out", place(path, number));
            skipped.push(Skipped::new(SkipKind::Line, why, text));
            continue;
        };
        let is_depth = |file: &Path| {
            let inside = file.strip_prefix(folder).unwrap_or(file).to_string_lossy().to_ascii_lowercase();
            inside.contains("depth")
        };
        let (c, d) = if is_depth(&first.1) { (second, first) } else { (first, second) };
        colour.push((c.0, ImageAt::File(c.1)));
        depth.push((d.0, ImageAt::File(d.1)));
    }
    if colour.is_empty() {
        let cure = "each line must be: time stamp, colour image, time stamp, depth image";
        return Err(SourceError::new(path.display().to_string(), "names no images", cure));
    }
    Ok((colour, depth))
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
