//! Rig files of all kinds; the kind is detected.

mod airslam;
mod assumed;
mod basalt;
mod camodocal;
mod colmap;
mod document;
mod dso;
mod euroc;
pub mod kalibr;
pub mod kitti;
mod larvio;
mod maplab;
mod named;
mod nice_slam;
mod okvis;
mod open3d;
mod orbslam;
mod own;
mod realsense;
mod ros;
mod stella;
mod unused;
mod vikit;

pub use assumed::assumed_in;
pub use document::CalibrationError;
pub use euroc::folder as euroc_folder;
pub use named::{NAMED_RIGS, NamedRig, named_rig};

use crate::text::{data_lines, read_text};
use cairn_sensor::{Rig, SourceError};
pub use document::Document;
use std::path::{Path, PathBuf};

/// Reads a rig: Cairn's own `.toml`, an EuRoC `sensor.yaml`, a Kalibr camera chain (with the IMU file next to
/// it), ORB-SLAM settings, a stella_vslam configuration, a ROS `camera_info`, a KITTI `calib.txt` next to its images, what other systems are given (VINS-Fusion,
/// OKVIS2, SVO, maplab, Basalt, Kimera, OpenVINS, NICE-SLAM, R-VIO, LARVIO, AirSLAM, the `camera.txt` of DSO, the `cameras.txt` of COLMAP, the `camera_intrinsic.json` of Open3D), the factory calibration of a RealSense (`rs-enumerate-devices -c > FILE`; `FILE:stereo`,
/// `FILE:infrared`, `FILE:848x480` choose other cameras and another size than colour with depth in 640x480), a folder that contains one of these, or a
/// known name (see [`named_rig`]).
///
/// # Errors
///
/// [`SourceError`] naming file and line, when there is no rig file of a known kind or its content is invalid.
pub fn read_rig(path: impl AsRef<Path>) -> Result<Rig, SourceError> {
    read_rig_for(path, None)
}

/// As [`read_rig`], with the image size, `[width, height]`, for files that do not state it.
///
/// # Errors
///
/// As [`read_rig`].
pub fn read_rig_for(path: impl AsRef<Path>, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let path = path.as_ref();
    if let Some(named) = path.to_str().and_then(named_rig).filter(|_| !path.exists()) {
        return Ok(named.rig);
    }
    let realsense = if path.exists() { None } else { realsense::choice(path) };
    let rig = match realsense {
        Some(choice) => of_realsense(&choice, size)?,
        None if path.is_dir() => in_folder(path, size)?,
        None => in_file(path, size)?,
    };
    rig.validate().map_err(|e| {
        SourceError::new(path.display().to_string(), e.to_string(), "correct the calibration")
    })?;
    Ok(rig)
}

/// The rig as text in Cairn's own format.
///
/// # Errors
///
/// [`SourceError`] when it cannot be written as TOML.
pub fn write_rig(rig: &Rig) -> Result<String, SourceError> {
    own::write(rig)
}

/// The rig file of a data set folder, if it has one besides the data set's own: `rig.toml`, or a Kalibr
/// chain.
pub fn file_in(folder: &Path) -> Option<PathBuf> {
    const NAMES: [&str; 6] = [
        "rig.toml",
        "camchain.yaml",
        "camchain-imucam.yaml",
        "kalibr_imucam_chain.yaml",
        "dso/camchain.yaml",
        "../dso/camchain.yaml",
    ];
    NAMES.iter().map(|name| folder.join(name)).find(|p| p.is_file())
}

/// The one chain of Kalibr in a folder, whatever its name.
pub fn chain_in(folder: &Path) -> Option<PathBuf> {
    let files = std::fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path()));
    let is_chain = |path: &PathBuf| {
        let yaml = path.extension().is_some_and(|e| e == "yaml" || e == "yml");
        let text = if yaml { read_text(path).ok() } else { None };
        text.and_then(|text| Document::parse(path, &text).ok())
            .is_some_and(|doc| doc.root.get("cam0").is_some())
    };
    let mut chains = files.filter(is_chain);
    let first = chains.next()?;
    chains.next().is_none().then_some(first)
}

fn in_folder(folder: &Path, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    if let Some(path) = file_in(folder) {
        return in_file(&path, size);
    }
    for root in [folder.to_owned(), folder.join("mav0")] {
        if root.join("cam0/sensor.yaml").is_file() {
            return euroc::folder(&root);
        }
    }
    let calib = folder.join("calib.txt");
    if calib.is_file() {
        return in_file(&calib, size);
    }
    Err(SourceError::new(
        folder.display().to_string(),
        "holds no rig (rig.toml, cam0/sensor.yaml, a Kalibr camchain or calib.txt)",
        "name the calibration file itself",
    ))
}

fn in_file(path: &Path, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let name = path.file_name().map(|n| n.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if name.ends_with(".toml") {
        return own::read(path);
    }
    let text = read_text(path)?;
    let kitti = data_lines(&text).any(|(_, l)| l.starts_with("P0:") || l.starts_with("P_rect_00:"));
    if kitti {
        return kitti_file(path, size);
    }
    if realsense::is(&text)
        && let Some(choice) = realsense::choice(path)
    {
        return realsense::rig(&text, &choice, size);
    }
    if colmap::is(&text) {
        return colmap::rig(path, &text);
    }
    if dso::is(&text) {
        return dso::rig(path, &text);
    }
    if let Some((why, cure)) = not_read(&name, &text) {
        return Err(SourceError::new(path.display().to_string(), why, cure));
    }
    let unknown = |line_cure: &str| {
        SourceError::new(
            path.display().to_string(),
            "is not a rig file of a known kind (Cairn TOML, EuRoC sensor.yaml, Kalibr camchain, ORB-SLAM settings, stella_vslam, ROS camera_info, KITTI calib.txt, VINS-Fusion and camodocal, OKVIS2, SVO, maplab, Basalt, Kimera, OpenVINS, NICE-SLAM, R-VIO, LARVIO, AirSLAM, DSO camera.txt, COLMAP cameras.txt, Open3D camera_intrinsic.json, rs-enumerate-devices -c)",
            line_cure,
        )
    };
    if ![".yaml", ".yml", ".json"].iter().any(|end| name.ends_with(end)) {
        return Err(unknown("give one of these"));
    }
    let doc = Document::parse(path, &text)?;
    if airslam::is(&doc.root) {
        airslam::rig(&doc)
    } else if vikit::is(&doc.root) {
        vikit::rig(&doc)
    } else if doc.root.get("cam0").is_some() {
        kalibr::chain(&doc, None)
    } else if doc.root.get("T_BS").is_some() && doc.root.get("camera_model").is_some() {
        euroc::single(&doc)
    } else if let Some(chain) = doc.root.get("relative_config_imucam") {
        kalibr::of_openvins(&doc, chain)
    } else if camodocal::is(&doc.root) {
        camodocal::rig(&doc)
    } else if maplab::is(&doc.root) {
        maplab::rig(&doc)
    } else if larvio::is(&doc.root) {
        larvio::rig(&doc)
    } else if okvis::is(&doc.root) {
        okvis::rig(&doc)
    } else if basalt::is(&doc.root) {
        basalt::rig(&doc)
    } else if nice_slam::is(&doc.root) {
        nice_slam::rig(&doc)
    } else if euroc::is_kimera_pair(&doc.root) {
        euroc::kimera_pair(&doc)
    } else if stella::is_config(&doc.root) {
        stella::rig(&doc, size)
    } else if open3d::is(&doc.root) {
        open3d::rig(&doc)
    } else if ros::is_camera_info(&doc.root) {
        ros::rig(&doc)
    } else if orbslam::is_settings(&doc.root) {
        orbslam::rig(&doc, size)
    } else if doc.root.get("imu0").is_some() || doc.root.get("gyroscope_noise_density").is_some() {
        Err(unknown("this is an IMU file: give the camera chain, the IMU file next to it is found"))
    } else {
        Err(unknown("give one of these"))
    }
}

/// What a file of another system is whose calibration is not read, and the way out.
fn not_read(name: &str, text: &str) -> Option<(&'static str, &'static str)> {
    if text.contains("polynomial coefficients for the DIRECT mapping function") {
        Some((
            "is a calibration of OCamCalib, a lens of Scaramuzza's polynomial",
            "calibrate it with Kalibr as omni-radtan or pinhole-equi",
        ))
    } else if name.ends_with(".info") && text.contains("CalibrationFile") {
        Some((
            "is a configuration of ROVIO",
            "give the camera's file, which its CalibrationFile names; with the IMU write a rig.toml",
        ))
    } else {
        None
    }
}

/// A RealSense's calibration with a choice after its name.
fn of_realsense(choice: &realsense::Choice, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let text = read_text(&choice.path)?;
    if !realsense::is(&text) {
        let why = "is no calibration of a RealSense, so nothing can be chosen of it";
        return Err(SourceError::new(
            choice.path.display().to_string(),
            why,
            "leave out what follows the colon",
        ));
    }
    realsense::rig(&text, choice, size)
}

fn kitti_file(path: &Path, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let all = kitti::projections(path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let gray = !folder.join("image_2").is_dir() || folder.join("image_0").is_dir();
    let which: [usize; 2] = if gray { [0, 1] } else { [2, 3] };
    let size = match size {
        Some(size) => size,
        None => crate::numbered::image_size(&folder.join(format!("image_{}", which[0]))).map_err(|why| {
            SourceError::new(
                path.display().to_string(),
                format!("does not state the size of the images ({why})"),
                "keep it next to image_0, or write a rig.toml",
            )
        })?,
    };
    let present: Vec<usize> = which.into_iter().filter(|&i| all[i].is_some()).collect();
    kitti::rig(path, &all, &present, size)
}
