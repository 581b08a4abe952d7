//! Rig files of all kinds; the kind is detected.

mod airslam;
mod assumed;
mod basalt;
mod camodocal;
mod colmap;
mod depthai;
mod document;
mod dso;
mod euroc;
pub mod kalibr;
pub mod kitti;
mod larvio;
mod maplab;
mod named;
mod nerf;
mod nice_slam;
mod notation;
mod numbers;
mod okvis;
mod open3d;
mod opencv;
mod orbslam;
mod ost;
mod ov2slam;
mod own;
mod realsense;
mod ros;
mod stella;
mod unused;
mod vikit;
mod xml;
mod zed;

pub use assumed::assumed_in;
pub use document::CalibrationError;
pub use euroc::folder as euroc_folder;
pub use named::{NAMED_RIGS, NamedRig, named_rig};

use crate::text::{data_lines, read_text};
use cairn_files::yaml::Node;
use cairn_sensor::{Rig, SourceError};
pub use document::Document;
use std::path::{Path, PathBuf};

/// Reads a rig: Cairn's own `.toml`, an EuRoC `sensor.yaml`, a Kalibr camera chain (with the IMU file next to
/// it), ORB-SLAM settings, a stella_vslam configuration, a ROS `camera_info` or `ost.txt`, what OpenCV writes (YAML, XML, JSON), a KITTI `calib.txt` next to its
/// images, what other systems are given (VINS-Fusion, OKVIS2, SVO, maplab, Basalt, Kimera, OpenVINS, OV2SLAM, XRSLAM, NICE-SLAM, MonoGS, SplaTAM, R-VIO, LARVIO,
/// AirSLAM, R3LIVE, the `camera.txt` of DSO, the one line of DROID-SLAM, the `cameras.txt` of COLMAP, the `transforms.json` of nerfstudio, the `camera_intrinsic.json` of Open3D), the factory
/// calibration of a ZED (`SN*.conf`), an OAK (DepthAI's JSON) or a RealSense (`rs-enumerate-devices -c > FILE`; `FILE:stereo`,
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

/// The kinds that are read, for errors.
const KINDS: &str = "Cairn TOML, EuRoC sensor.yaml, Kalibr camchain, ORB-SLAM settings, stella_vslam, ROS camera_info and ost.txt, OpenCV, KITTI calib.txt, VINS-Fusion and camodocal, OKVIS2, SVO, maplab, Basalt, Kimera, OpenVINS, OV2SLAM, XRSLAM, NICE-SLAM, MonoGS, SplaTAM, R-VIO, LARVIO, AirSLAM, R3LIVE, DSO camera.txt, DROID-SLAM, COLMAP cameras.txt, nerfstudio transforms.json, Open3D camera_intrinsic.json, ZED SN*.conf, DepthAI, rs-enumerate-devices -c";

type Size = Option<[usize; 2]>;

/// A kind of file in YAML, JSON or OpenCV's XML: whether a file is one, and its reader.
type Reader = (fn(&Node) -> bool, fn(&Document, Size) -> Result<Rig, SourceError>);

/// In the order in which they are tried.
const READERS: [Reader; 24] = [
    (airslam::is, |doc, _| airslam::rig(doc)),
    (vikit::is, |doc, _| vikit::rig(doc)),
    (ov2slam::is, |doc, _| ov2slam::rig(doc)),
    (|root| root.get("cam0").is_some(), |doc, _| kalibr::chain(doc, None)),
    (|root| root.get("T_BS").is_some() && root.get("camera_model").is_some(), |doc, _| euroc::single(doc)),
    (|root| root.get("relative_config_imucam").is_some(), |doc, _| kalibr::of_openvins(doc)),
    (camodocal::is, |doc, _| camodocal::rig(doc)),
    (maplab::is, |doc, _| maplab::rig(doc)),
    (larvio::is, |doc, _| larvio::rig(doc)),
    (okvis::is, |doc, _| okvis::rig(doc)),
    (basalt::is, |doc, _| basalt::rig(doc)),
    (nice_slam::is, |doc, _| nice_slam::rig(doc)),
    (euroc::is_kimera_pair, |doc, _| euroc::kimera_pair(doc)),
    (stella::is_config, stella::rig),
    (open3d::is, |doc, _| open3d::rig(doc)),
    (depthai::is, |doc, _| depthai::rig(doc)),
    (nerf::is, |doc, _| nerf::rig(doc)),
    (numbers::is_listed, |doc, _| numbers::listed(doc)),
    (opencv::is_pair, opencv::pair),
    (ros::is_camera_info, ros::rig),
    (orbslam::is_settings, orbslam::rig),
    (is_imu, |doc, _| {
        Err(unknown(
            &doc.path,
            "this is an IMU file: give the camera chain, the IMU file next to it is found",
        ))
    }),
    (
        |root| root.get("depth_to_meters").is_some(),
        |doc, _| Err(unknown(&doc.path, "give LeftCameraParams.yaml, this file next to it is found")),
    ),
    (|_| true, |doc, _| Err(unknown(&doc.path, "give one of these"))),
];

fn is_imu(root: &Node) -> bool {
    ["imu0", "gyroscope_noise_density", "Gyr"].iter().any(|key| root.get(key).is_some())
}

fn unknown(path: &Path, cure: &str) -> SourceError {
    SourceError::new(path.display().to_string(), format!("is not a rig file of a known kind ({KINDS})"), cure)
}

fn in_file(path: &Path, size: Size) -> Result<Rig, SourceError> {
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
    if numbers::is(&text) {
        return numbers::rig(path, &text, size);
    }
    if zed::is(&text) {
        return zed::rig(path, &text, size);
    }
    if let Some((why, cure)) = not_read(&name, &text) {
        return Err(SourceError::new(path.display().to_string(), why, cure));
    }
    let Some(doc) = notation::document(path, &text)? else { return Err(unknown(path, "give one of these")) };
    let reader = READERS.iter().find(|(is, _)| is(&doc.root));
    reader.map_or_else(|| Err(unknown(path, "give one of these")), |(_, rig)| rig(&doc, size))
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
    let size = match size.or(kitti::stated_size(path)?) {
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
