//! Cameras of AirSLAM: `cam0` and `cam1` with a matrix `T` whose direction `T_type` says, and one size and kind of lens for both.

use super::document::Document;
use super::kalibr;
use cairn_files::yaml::Node;
use cairn_sensor::{Distortion, Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("image_width").is_some() && root.get("cam0").is_some_and(|cam| cam.get("T").is_some())
}

/// One or two cameras, and the IMU, which is the body.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let root = &doc.root;
    let nodes = ["cam0", "cam1"].into_iter().filter_map(|name| Some((name, root.get(name)?)));
    let cameras = nodes.map(|(name, node)| camera(doc, name, node)).collect::<Result<_, SourceError>>()?;
    let used = root.get("use_imu").is_none_or(|n| n.text() != Some("0"));
    let imu = match root.get("gyroscope_noise_density").filter(|_| used) {
        Some(_) => Some(kalibr::imu(doc, root, "rate_hz")?),
        None => None,
    };
    Ok(Rig { cameras, depth: None, imu })
}

fn camera(doc: &Document, name: &str, node: &Node) -> Result<RigCamera, SourceError> {
    let size = [doc.need_number(&doc.root, "image_width")?, doc.need_number(&doc.root, "image_height")?];
    let pinhole = doc.array::<4>(doc.need(node, "intrinsics")?, "intrinsics")?;
    let lens = doc.need(node, "distortion_coeffs")?;
    let c = doc.numbers(lens)?;
    let kind = doc.need(&doc.root, "distortion_type")?;
    let distortion = match (kind.text().unwrap_or_default(), c.as_slice()) {
        ("0", _) => Distortion::None,
        ("1", c) => doc.distortion(lens.line, "radtan", c)?,
        ("2", &[k1, k2, k3, k4, ..]) => Distortion::Equidistant([k1, k2, k3, k4]),
        (other, c) => {
            let why =
                format!("distortion_type {other} with {} coefficients is not known (0, 1, 2 are)", c.len());
            return Err(doc.error(kind.line, why));
        }
    };
    let camera = doc.camera(node.line, doc.size(node.line, size)?, pinhole, distortion)?;
    let t = doc.transform(doc.need(node, "T")?, "T")?;
    let direction = doc.need(node, "T_type")?;
    let body_from_camera = match direction.text().unwrap_or_default() {
        "0" => t,
        "1" => t.inverse(),
        other => return Err(doc.error(direction.line, format!("T_type {other} is not known (0 and 1 are)"))),
    };
    Ok(RigCamera { name: name.into(), camera, body_from_camera })
}
