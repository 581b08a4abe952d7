//! EuRoC rigs: one `sensor.yaml` per sensor, with `T_BS` from sensor to body.

use super::document::Document;
use super::kalibr;
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_sensor::{DepthSensor, Rig, RigCamera, SourceError};
use std::path::Path;

/// The rig of a folder with `cam0/sensor.yaml`, and `cam1` and `imu0` where present.
pub fn folder(root: &Path) -> Result<Rig, SourceError> {
    let mut cameras = Vec::new();
    for name in ["cam0", "cam1"] {
        let path = root.join(name).join("sensor.yaml");
        if path.is_file() {
            cameras.push(camera(&Document::parse(&path, &read_text(&path)?)?, name)?);
        }
    }
    let path = root.join("imu0").join("sensor.yaml");
    let imu = match path.is_file() {
        true => {
            let doc = Document::parse(&path, &read_text(&path)?)?;
            Some(kalibr::imu(&doc, &doc.root, "rate_hz")?)
        }
        false => None,
    };
    Ok(Rig { cameras, depth: None, imu })
}

/// One camera's file as a rig; the body is the file's body frame. Of Kimera's `LeftCameraParams.yaml` with what is beside it:
/// `RightCameraParams.yaml`, or `DepthCameraParams.yaml` of a depth that is registered to it, and `ImuParams.yaml`.
pub fn single(doc: &Document) -> Result<Rig, SourceError> {
    let mut rig = Rig { cameras: vec![camera(doc, "cam0")?], depth: None, imu: None };
    let name = doc.path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    let Some(rest) = name.strip_prefix("LeftCameraParams") else { return Ok(rig) };
    let beside = |name: &str| Some(doc.path.with_file_name(name)).filter(|path| path.is_file());
    if let Some(path) = beside(&format!("RightCameraParams{rest}")) {
        rig.cameras.push(camera(&Document::parse(&path, &read_text(&path)?)?, "cam1")?);
    } else if let Some(path) = beside("DepthCameraParams.yaml") {
        let depth = Document::parse(&path, &read_text(&path)?)?;
        rig.depth = Some(DepthSensor {
            camera: rig.cameras[0].camera,
            body_from_depth: rig.cameras[0].body_from_camera,
            metres_per_unit: depth.need_number(&depth.root, "depth_to_meters")?,
            registered: true,
        });
    }
    if let Some(path) = beside("ImuParams.yaml") {
        let doc = Document::parse(&path, &read_text(&path)?)?;
        let mut imu = kalibr::imu(&doc, &doc.root, "rate_hz")?;
        // Kimera: t_imu = t_image + shift.
        imu.offset_s = -doc.root.get("imu_time_shift").map_or(Ok(0.0), |n| doc.number(n))?;
        rig.imu = Some(imu);
    }
    Ok(rig)
}

/// True of Kimera's first form: both cameras and the IMU in one file, for MYNT EYE and RealSense.
pub fn is_kimera_pair(root: &Node) -> bool {
    root.get("left_camera_intrinsics").is_some()
}

/// That file's rig.
pub fn kimera_pair(doc: &Document) -> Result<Rig, SourceError> {
    let root = &doc.root;
    let size = doc.need(root, "camera_resolution")?;
    let size = doc.size(size.line, doc.array::<2>(size, "camera_resolution")?)?;
    let kind = doc.need(root, "distortion_model")?;
    let model = doc.need(root, "camera_model")?;
    if model.text() != Some("pinhole") {
        let name = model.text().unwrap_or_default();
        return Err(doc.error(model.line, format!("camera model \"{name}\" is not known (pinhole is)")));
    }
    let to_body = doc.transform(doc.need(root, "calibration_to_body_frame")?, "calibration_to_body_frame")?;
    let camera = |(i, side): (usize, &str)| {
        let key = |what: &str| format!("{side}_camera_{what}");
        let node = |what: &str| doc.need(root, &key(what));
        let intrinsics = node("intrinsics")?;
        let c = doc.numbers(node("distortion_coefficients")?)?;
        let lens = doc.distortion(kind.line, kind.text().unwrap_or_default(), &c)?;
        let pinhole = doc.array::<4>(intrinsics, &key("intrinsics"))?;
        Ok(RigCamera {
            name: format!("cam{i}"),
            camera: doc.camera(intrinsics.line, size, pinhole, lens)?,
            body_from_camera: to_body * doc.transform(node("extrinsics")?, &key("extrinsics"))?,
        })
    };
    let cameras =
        ["left", "right"].into_iter().enumerate().map(camera).collect::<Result<_, SourceError>>()?;
    let mut imu = kalibr::imu(doc, root, "imu_rate_hz")?;
    imu.body_from_imu = doc.transform(doc.need(root, "imu_extrinsics")?, "imu_extrinsics")?;
    // As its comment says: t_imu = t_image + shift.
    imu.offset_s = -doc.need_number(root, "imu_shift")?;
    Ok(Rig { cameras, depth: None, imu: Some(imu) })
}

fn camera(doc: &Document, name: &str) -> Result<RigCamera, SourceError> {
    let body_from_camera = doc.transform(doc.need(&doc.root, "T_BS")?, "T_BS")?;
    Ok(RigCamera { name: name.into(), camera: kalibr::camera(doc, &doc.root)?, body_from_camera })
}
