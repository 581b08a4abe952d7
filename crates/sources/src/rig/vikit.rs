//! Cameras of vikit (SVO's first version, REMODE, FAST-LIVO): `cam_model` with `cam_width`, `cam_fx`, `cam_d0`, at the root of the
//! file, or under `cam0` and `cam1` with their places on the IMU; in ROS 2 under `camera`, without `cam_`.

use super::document::{Document, SCARAMUZZA};
use super::kalibr;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    cameras(root).next().is_some()
}

/// The nodes of cameras with their names.
fn cameras(root: &Node) -> impl Iterator<Item = (&'static str, &Node)> {
    let nodes = [
        ("cam0", Some(root)),
        ("cam0", root.get("cam0")),
        ("cam1", root.get("cam1")),
        ("cam0", root.get("camera")),
    ];
    let has_keys = |node: &Node| value(node, "model").is_some() && value(node, "width").is_some();
    nodes.into_iter().filter_map(move |(name, node)| Some((name, node.filter(|node| has_keys(node))?)))
}

/// The value of a key, with or without `cam_` before it.
fn value<'a>(node: &'a Node, key: &str) -> Option<&'a Node> {
    node.get(&format!("cam_{key}")).or_else(|| node.get(key).filter(|_| node.get("d0").is_some()))
}

/// The cameras, with the IMU whose file lies beside.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let (mut rig, mut all_placed) = (Rig { cameras: Vec::new(), depth: None, imu: None }, true);
    for (name, node) in cameras(&doc.root) {
        let place = place(doc, node)?;
        all_placed &= place.is_some();
        if rig.cameras.len() == 1 && !all_placed {
            return Err(
                doc.error(node.line, "T_imu_cam is missing: two cameras need their places on the IMU")
            );
        }
        let body_from_camera = place.unwrap_or_else(Se3::identity);
        rig.cameras.push(RigCamera { name: name.into(), camera: camera(doc, node)?, body_from_camera });
    }
    if let Some(path) = kalibr::imu_path(doc).filter(|_| all_placed) {
        rig.imu = Some(kalibr::imu_file(&path)?);
    }
    Ok(rig)
}

/// The IMU from the camera, given in either direction.
fn place(doc: &Document, node: &Node) -> Result<Option<Se3>, SourceError> {
    let (t, inverse) = match (node.get("T_imu_cam"), node.get("T_cam_imu")) {
        (Some(t), _) => (t, false),
        (None, Some(t)) => (t, true),
        (None, None) => return Ok(None),
    };
    let number = |key: &str| doc.need_number(t, key);
    let rotation = So3::from_xyzw(number("qx")?, number("qy")?, number("qz")?, number("qw")?)
        .ok_or_else(|| doc.error(t.line, "the quaternion is no rotation"))?;
    let pose = Se3::new(rotation, Vec3::new(number("tx")?, number("ty")?, number("tz")?));
    Ok(Some(if inverse { pose.inverse() } else { pose }))
}

/// One camera. Of ATAN focal lengths and centre are shares of the sides, from the corner of the first pixel (Klein and Murray,
/// "Parallel tracking and mapping for small AR workspaces" (2007)).
fn camera(doc: &Document, node: &Node) -> Result<Camera, SourceError> {
    let need =
        |key: &str| value(node, key).ok_or_else(|| doc.error(node.line, format!("cam_{key} is missing")));
    let number = |key: &str| doc.number(need(key)?);
    let [w, h] = [number("width")?, number("height")?];
    let size = doc.size(node.line, [w, h])?;
    let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(number);
    let numbers = [fx?, fy?, cx?, cy?];
    let coefficients = |prefix: &str, first: usize| {
        let keys = (first..first + 5)
            .map(|k| value(node, &format!("{prefix}{k}")).or(node.get(&format!("{prefix}{k}"))));
        keys.map_while(|value| value.map(|value| doc.number(value))).collect::<Result<Vec<f64>, _>>()
    };
    let c = coefficients("d", 0)?;
    let model = need("model")?;
    let name = model.text().unwrap_or_default();
    let (numbers, distortion) = match name.to_ascii_lowercase().as_str() {
        "pinhole" | "pinholeradtan" if c.iter().all(|v| *v == 0.0) => (numbers, Distortion::None),
        "pinhole" | "pinholeradtan" => (numbers, doc.distortion(model.line, "radtan", &c)?),
        "pinholeequidistant" => (numbers, doc.distortion(model.line, "equidistant", &c)?),
        "equidistantcamera" => (numbers, doc.distortion(model.line, "equidistant", &coefficients("k", 1)?)?),
        "atan" | "pinholeatan" => {
            let [fx, fy, cx, cy] = numbers;
            ([fx * w, fy * h, cx * w - 0.5, cy * h - 0.5], doc.distortion(model.line, "fov", &c)?)
        }
        "ocam" => return Err(doc.error(model.line, format!("cam_model \"{name}\": {SCARAMUZZA}"))),
        _ => {
            let why = format!(
                "cam_model \"{name}\" is not known (Pinhole, PinholeRadTan, PinholeEquidistant, EquidistantCamera and ATAN are)"
            );
            return Err(doc.error(model.line, why));
        }
    };
    doc.camera(model.line, size, numbers, distortion)
}
