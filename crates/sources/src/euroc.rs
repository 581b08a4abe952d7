//! EuRoC folders (`mav0/cam0 cam1 imu0`), and TUM-VI, which has the same layout with a Kalibr calibration.
//!
//! An additional `depth0/`, of 16-bit PNG at the stamps of `cam0`, is read where the rig has a depth sensor.
//! Burri et al., "The EuRoC micro aerial vehicle datasets" (2016); Schubert et al., "The TUM VI benchmark" (2018).

use crate::imu::Columns;
use crate::recording::{
    ImageAt, ImuAt, Instant, Recording, apart, join_depth, named_by_time, pair, read_index, read_truth,
};
use crate::rig;
use crate::text::stamp_any;
use cairn_eval::Format;
use cairn_geometry::Se3;
use cairn_sensor::{Rig, SkipKind, Skipped, SourceError, Stamp};
use std::path::Path;

/// Stamps of cameras triggered together differ by less, nanoseconds; images of others are paired within half the time between
/// two, which is told.
const SAME_INSTANT_NS: u64 = 500_000;

/// True when a folder looks like an EuRoC or TUM-VI recording.
pub fn is(folder: &Path) -> bool {
    [folder.to_owned(), folder.join("mav0")].iter().any(|root| root.join("cam0").is_dir())
}

/// Indexes the folder. Its rig is the one given, a Cairn or Kalibr file in it, or its `sensor.yaml` files. The rig
/// decides what is read: one camera or two, the IMU or not.
pub fn index(folder: &Path, given: Option<Rig>) -> Result<Recording, SourceError> {
    let root = if folder.join("mav0").is_dir() { folder.join("mav0") } else { folder.to_owned() };
    let has = |camera: &str| {
        let folder = root.join(camera);
        folder.join("data.csv").exists()
            || folder.join("data").exists()
            || !named_by_time(&folder, stamp_any).is_empty()
    };
    let cameras = 1 + usize::from(has("cam1"));
    let mut rig = match given {
        Some(rig) if rig.cameras.len() > cameras => {
            return Err(SourceError::new(
                folder.display().to_string(),
                format!("the rig has {} cameras, the folder has images of {cameras}", rig.cameras.len()),
                "give a rig of the cameras that are there",
            ));
        }
        Some(rig) => rig,
        None => own_rig(folder, &root)?,
    };
    rig.cameras.truncate(cameras);

    let mut skipped = Vec::new();
    let mut lists = Vec::new();
    for i in 0..rig.cameras.len() {
        lists.push(images(&root.join(format!("cam{i}")), &mut skipped)?);
    }
    let mut instants = match lists.as_slice() {
        [left, right, ..] => {
            let (median_ns, half_ns) = apart(left, right);
            if median_ns > SAME_INSTANT_NS {
                let text = format!(
                    "left and right images {:.1} ms apart, taken as of one instant: at 1 m/s they are {:.1} mm wrong",
                    median_ns as f64 / 1e6,
                    median_ns as f64 / 1e6
                );
                skipped.push(Skipped::new(SkipKind::Other, "left and right images are apart", text));
            }
            pair(left, right, half_ns.max(SAME_INSTANT_NS), &mut skipped)
        }
        [one] => one
            .iter()
            .map(|(stamp, path)| Instant { stamp: *stamp, images: vec![path.clone()], depth: None })
            .collect(),
        [] => Vec::new(),
    };
    let depth = root.join("depth0");
    match depth.join("data.csv").is_file() {
        true if rig.depth.is_some() => {
            join_depth(&mut instants, images(&depth, &mut skipped)?, SAME_INSTANT_NS)
        }
        _ => rig.depth = None,
    }
    let imu = root.join("imu0/data.csv");
    if !imu.is_file() {
        rig.imu = None;
    }
    Ok(Recording {
        name: format!("EuRoC folder {}", folder.display()),
        imu: rig.imu.is_some().then_some(ImuAt::Csv(imu, Columns::default())),
        bag: None,
        rig,
        instants,
        truth: truth(&root, &mut skipped)?,
        no_depth: None,
        skipped,
        assumed: None,
    })
}

fn own_rig(folder: &Path, root: &Path) -> Result<Rig, SourceError> {
    if let Some(path) = rig::file_in(root).or_else(|| rig::file_in(folder)) {
        return rig::read_rig(path);
    }
    let rig = rig::euroc_folder(root)?;
    if rig.cameras.is_empty() {
        return Err(SourceError::new(
            root.join("cam0/sensor.yaml").display().to_string(),
            "is missing, and there is no other calibration",
            "give one with --rig",
        ));
    }
    Ok(rig)
}

fn images(camera: &Path, skipped: &mut Vec<Skipped>) -> Result<Vec<(Stamp, ImageAt)>, SourceError> {
    let (list, folder) = (camera.join("data.csv"), camera.join("data"));
    if !list.is_file() {
        let named = [&folder, camera].map(|folder| named_by_time(folder, stamp_any));
        if let Some(named) = named.into_iter().find(|named| !named.is_empty()) {
            return Ok(named);
        }
    }
    read_index(&list, stamp_any, &folder, skipped)
}

/// Ground-truth poses of the body, if one of the data sets' files has them.
fn truth(root: &Path, skipped: &mut Vec<Skipped>) -> Result<Vec<(Stamp, Se3)>, SourceError> {
    for name in ["state_groundtruth_estimate0", "mocap0"] {
        let path = root.join(name).join("data.csv");
        if path.is_file() {
            return read_truth(&path, Format::Euroc, skipped);
        }
    }
    let path = root.join("groundtruth.txt");
    if path.is_file() { read_truth(&path, Format::Tum, skipped) } else { Ok(Vec::new()) }
}
