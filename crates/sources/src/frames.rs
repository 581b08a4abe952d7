//! Colour and depth in numbered files, as several data sets and scanning apps have them:
//!
//! | | colour | depth | calibration | poses |
//! |---|---|---|---|---|
//! | Replica (as NICE-SLAM renders it) | `results/frame000000.jpg` | `results/depth000000.png` | `cam_params.json` here or above | `traj.txt` |
//! | ScanNet | `color/0.jpg` | `depth/0.png`, mm | `intrinsic/intrinsic_color.txt`, `..._depth.txt` | `pose/0.txt` |
//! | Stray Scanner | `rgb/000000.jpg` | `depth/000000.png`, mm | `camera_matrix.csv` | times of `odometry.csv` |
//! | Record3D | `rgb/0.jpg` | none that is read (EXR) | `metadata.json` | none |
//!
//! Without times they are played at 30 images a second.

use crate::numbered::{image_size, numbered_after};
use crate::recording::{ImageAt, Instant, Recording};
use crate::rig;
use crate::text::{data_lines, fields, numbers, read_text, stamp_seconds};
use cairn_eval::pose_from_matrix;
use cairn_files::yaml::{self, Node};
use cairn_geometry::Se3;
use cairn_sensor::{Camera, DepthSensor, Rig, SkipKind, Skipped, SourceError, Stamp};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const STEP_NS: i64 = 33_333_333;

#[derive(Clone, Copy)]
enum Layout {
    Replica,
    ScanNet,
    Stray,
    Record3d,
}

impl Layout {
    fn of(folder: &Path) -> Option<Self> {
        let file = |name: &str| folder.join(name).is_file();
        if file("traj.txt") && folder.join("results").is_dir() {
            Some(Self::Replica)
        } else if folder.join("color").is_dir() && intrinsics_file(folder, "color").is_file() {
            Some(Self::ScanNet)
        } else if file("odometry.csv") && file("camera_matrix.csv") {
            Some(Self::Stray)
        } else if folder.join("rgb").is_dir() && metadata(folder).is_some() {
            Some(Self::Record3d)
        } else {
            None
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Replica => "Replica",
            Self::ScanNet => "ScanNet",
            Self::Stray => "Stray Scanner",
            Self::Record3d => "Record3D",
        }
    }

    /// Folder and beginning of the names of colour and depth.
    fn images(self) -> [(&'static str, &'static str); 2] {
        match self {
            Self::Replica => [("results", "frame"), ("results", "depth")],
            Self::ScanNet => [("color", ""), ("depth", "")],
            Self::Stray | Self::Record3d => [("rgb", ""), ("depth", "")],
        }
    }
}

/// True when a folder has one of these layouts.
pub fn is(folder: &Path) -> bool {
    Layout::of(folder).is_some()
}

/// Indexes the folder; its rig is the one given, a Cairn or Kalibr file in it, or its own calibration.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let shown = folder.display().to_string();
    let Some(layout) = Layout::of(folder) else {
        return Err(SourceError::new(shown, "is no folder of numbered frames", "choose another --as"));
    };
    let [(colour, frame), (depth, of_depth)] = layout.images();
    let (colour, depth) = (folder.join(colour), folder.join(depth));
    let video = folder.join("rgb.mp4");
    if !colour.is_dir() && video.is_file() {
        let cure = format!(
            "take the images out of the film: mkdir {0} && ffmpeg -i {1} -q:v 2 -start_number 0 {0}/%06d.jpg",
            colour.display(),
            video.display()
        );
        return Err(SourceError::new(shown, "has its colour images in rgb.mp4", cure));
    }
    let unreadable = |e: crate::numbered::NumberedError| {
        SourceError::new(folder.display().to_string(), e.to_string(), "check the images")
    };
    let mut rig = match (given, rig::file_in(folder)) {
        (Some(rig), _) => rig,
        (None, Some(path)) => rig::read_rig(path)?,
        (None, None) => own_rig(layout, folder, || image_size(&colour).map_err(unreadable))?,
    };
    rig.cameras.truncate(1);
    rig.imu = None;
    let depths: BTreeMap<usize, PathBuf> = match rig.depth.is_some() && depth.is_dir() {
        true => numbered_after(&depth, of_depth)
            .unwrap_or_default()
            .into_iter()
            .map(|f| (f.number, f.path))
            .collect(),
        false => BTreeMap::new(),
    };
    if depths.is_empty() {
        rig.depth = None;
    }
    let (times, poses) = (times(layout, folder)?, poses(layout, folder)?);
    let (mut instants, mut truth, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
    for file in numbered_after(&colour, frame).map_err(unreadable)? {
        let stamp = match &times {
            None => Stamp(file.number as i64 * STEP_NS),
            Some(times) => match times.get(&file.number) {
                Some(stamp) => *stamp,
                None => {
                    let (why, text) = ("odometry.csv has no time for it", file.path.display().to_string());
                    skipped.push(Skipped::new(SkipKind::Frame, why, format!("{text}: {why}")));
                    continue;
                }
            },
        };
        truth.extend(poses.get(&file.number).map(|pose| (stamp, *pose)));
        instants.push(Instant {
            stamp,
            images: vec![ImageAt::File(file.path)],
            depth: depths.get(&file.number).cloned().map(ImageAt::File),
        });
    }
    Ok(Recording {
        name: format!("{} folder {shown}", layout.name()),
        rig,
        instants,
        imu: None,
        bag: None,
        truth,
        no_depth: None,
        skipped,
        assumed: None,
    })
}

fn intrinsics_file(folder: &Path, of: &str) -> PathBuf {
    let name = format!("intrinsic_{of}.txt");
    let inner = folder.join("intrinsic").join(&name);
    if inner.is_file() { inner } else { folder.join(name) }
}

fn metadata(folder: &Path) -> Option<Node> {
    let text = read_text(&folder.join("metadata.json")).ok()?;
    let root = yaml::parse(&text).ok()?;
    (root.get("K").is_some() && root.get("w").is_some()).then_some(root)
}

fn own_rig(
    layout: Layout,
    folder: &Path,
    size: impl Fn() -> Result<[usize; 2], SourceError>,
) -> Result<Rig, SourceError> {
    match layout {
        Layout::Replica => {
            let files = [folder.join("cam_params.json"), folder.join("../cam_params.json")];
            let found = files.iter().find(|path| path.is_file());
            rig::read_rig(found.ok_or_else(|| {
                SourceError::new(
                    files[0].display().to_string(),
                    "is missing, also above",
                    "give one with --rig",
                )
            })?)
        }
        Layout::ScanNet => {
            let camera = of_matrix(&intrinsics_file(folder, "color"), 4, size()?)?;
            let path = intrinsics_file(folder, "depth");
            let depth_size = image_size(&folder.join("depth")).ok().filter(|_| path.is_file());
            let depth = depth_size.map(|size| of_matrix(&path, 4, size)).transpose()?;
            Ok(Rig { depth: depth.map(|depth| sensor(depth, false)), ..Rig::mono(camera) })
        }
        Layout::Stray => {
            let camera = of_matrix(&folder.join("camera_matrix.csv"), 3, size()?)?;
            Ok(Rig { depth: Some(sensor(camera, true)), ..Rig::mono(camera) })
        }
        Layout::Record3d => {
            let path = folder.join("metadata.json");
            let wrong = || SourceError::new(path.display().to_string(), "K is no 3x3 matrix", "give --rig");
            let root = metadata(folder).ok_or_else(wrong)?;
            let list = root.get("K").and_then(Node::list).unwrap_or_default();
            let texts: Vec<&str> = list.iter().filter_map(Node::text).collect();
            // By columns.
            let k = numbers::<9>(texts.into_iter()).ok_or_else(wrong)?;
            let [w, h] = size()?;
            checked(&path, Camera::pinhole(w, h, k[0], k[4], k[6], k[7])).map(Rig::mono)
        }
    }
}

/// Depth in millimetres.
fn sensor(camera: Camera, registered: bool) -> DepthSensor {
    DepthSensor { camera, body_from_depth: Se3::identity(), metres_per_unit: 0.001, registered }
}

/// A camera of a file with a matrix of rows of `columns` numbers.
fn of_matrix(path: &Path, columns: usize, [w, h]: [usize; 2]) -> Result<Camera, SourceError> {
    let text = read_text(path)?;
    let wrong = || {
        SourceError::new(path.display().to_string(), "is no 3x3 or 4x4 matrix", "correct it, or give --rig")
    };
    let all: Vec<f64> = fields(&text).map(|f| f.parse().unwrap_or(f64::NAN)).collect();
    if all.len() < 3 * columns {
        return Err(wrong());
    }
    checked(path, Camera::pinhole(w, h, all[0], all[columns + 1], all[2], all[columns + 2]))
}

fn checked(path: &Path, camera: Camera) -> Result<Camera, SourceError> {
    let wrong = |why: String| SourceError::new(path.display().to_string(), why, "correct it, or give --rig");
    camera.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(camera)
}

/// The times of Stray Scanner's frames: `timestamp, frame, ...`.
fn times(layout: Layout, folder: &Path) -> Result<Option<BTreeMap<usize, Stamp>>, SourceError> {
    if !matches!(layout, Layout::Stray) {
        return Ok(None);
    }
    let text = read_text(&folder.join("odometry.csv"))?;
    let row = |(_, line): (usize, &str)| {
        let mut words = fields(line);
        let stamp = stamp_seconds(words.next()?)?;
        Some((words.next()?.parse().ok()?, stamp))
    };
    Ok(Some(data_lines(&text).filter_map(row).collect()))
}

/// True poses of the camera by the number of its frame; those that are not finite are left out.
fn poses(layout: Layout, folder: &Path) -> Result<BTreeMap<usize, Se3>, SourceError> {
    let of = |text: &str| pose_from_matrix(&numbers::<16>(fields(text))?).ok();
    match layout {
        Layout::Replica => {
            let text = read_text(&folder.join("traj.txt"))?;
            Ok(data_lines(&text).enumerate().filter_map(|(k, (_, line))| Some((k, of(line)?))).collect())
        }
        Layout::ScanNet => {
            let folder = folder.join("pose");
            Ok(numbered_texts(&folder)
                .filter_map(|(n, path)| Some((n, of(&read_text(&path).ok()?)?)))
                .collect())
        }
        Layout::Stray | Layout::Record3d => Ok(BTreeMap::new()),
    }
}

fn numbered_texts(folder: &Path) -> impl Iterator<Item = (usize, PathBuf)> {
    std::fs::read_dir(folder).into_iter().flatten().filter_map(|entry| {
        let path = entry.ok()?.path();
        let number = path.file_stem()?.to_str()?.parse().ok()?;
        path.extension().is_some_and(|e| e == "txt").then_some((number, path))
    })
}
