//! Settings of OV2SLAM: `Camera.model_left`, `Camera.fxl`, `Camera.k1l` and the like, and the same with `r` for the right camera.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("Camera.model_left").is_some()
}

/// One camera with `stereo: 0`, else both, on the body by `body_T_cam0` and `body_T_cam1`.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let mono = doc.root.get("stereo").and_then(Node::text) == Some("0");
    let sides = ["left", "right"].into_iter().enumerate().take(if mono { 1 } else { 2 });
    let cameras = sides.map(|(i, side)| camera(doc, i, side)).collect::<Result<_, SourceError>>()?;
    Ok(Rig { cameras, depth: None, imu: None })
}

fn camera(doc: &Document, i: usize, side: &str) -> Result<RigCamera, SourceError> {
    let root = &doc.root;
    let letter = &side[..1];
    let four = |keys: [&str; 4]| -> Result<[f64; 4], SourceError> {
        let [a, b, c, d] = keys.map(|key| doc.need_number(root, &format!("Camera.{key}{letter}")));
        Ok([a?, b?, c?, d?])
    };
    let pinhole = four(["fx", "fy", "cx", "cy"])?;
    let model = doc.need(root, &format!("Camera.model_{side}"))?;
    // Of a fisheye p1 and p2 are the third and fourth coefficient.
    let c = four(["k1", "k2", "p1", "p2"])?;
    let lens = match model.text().unwrap_or_default() {
        "pinhole" => "radtan",
        "fisheye" => "equidistant",
        other => {
            let why = format!("Camera.model_{side} \"{other}\" is not known (pinhole and fisheye are)");
            return Err(doc.error(model.line, why));
        }
    };
    let [w, h] = ["width", "height"].map(|what| doc.need_number(root, &format!("Camera.{side}_n{what}")));
    let size = doc.size(model.line, [w?, h?])?;
    let key = format!("body_T_cam{i}");
    let body_from_camera = match root.get(&key) {
        Some(t) => doc.transform(t, &key)?,
        None if i == 0 => Se3::identity(),
        None => return Err(doc.error(0, format!("{key} is missing"))),
    };
    let camera = doc.camera(model.line, size, pinhole, doc.distortion(model.line, lens, &c)?)?;
    Ok(RigCamera { name: format!("cam{i}"), camera, body_from_camera })
}
