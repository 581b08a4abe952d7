//! Cameras of SVO's first version and REMODE (vikit): `cam_model: Pinhole` or `ATAN`, with `cam_width`, `cam_fx`, `cam_d0`.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_sensor::{Distortion, Rig, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("cam_model").is_some() && root.get("cam_width").is_some()
}

/// The camera. Of ATAN focal lengths and centre are shares of the sides, from the corner of the first pixel (Klein and Murray,
/// "Parallel tracking and mapping for small AR workspaces" (2007)).
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let number = |key: &str| doc.need_number(&doc.root, key);
    let [w, h] = [number("cam_width")?, number("cam_height")?];
    let size = doc.size(0, [w, h])?;
    let [fx, fy, cx, cy] = ["cam_fx", "cam_fy", "cam_cx", "cam_cy"].map(number);
    let numbers = [fx?, fy?, cx?, cy?];
    let mut c = Vec::new();
    for k in 0..5 {
        match doc.root.get(&format!("cam_d{k}")) {
            Some(node) => c.push(doc.number(node)?),
            None => break,
        }
    }
    let model = doc.need(&doc.root, "cam_model")?;
    let name = model.text().unwrap_or_default();
    let (numbers, distortion) = match name.to_ascii_lowercase().as_str() {
        "pinhole" if c.iter().all(|v| *v == 0.0) => (numbers, Distortion::None),
        "pinhole" => (numbers, doc.distortion(model.line, "radtan", &c)?),
        "atan" => {
            let [fx, fy, cx, cy] = numbers;
            ([fx * w, fy * h, cx * w - 0.5, cy * h - 0.5], doc.distortion(model.line, "fov", &c)?)
        }
        _ => {
            let why = format!("cam_model \"{name}\" is not known (Pinhole and ATAN are)");
            return Err(doc.error(model.line, why));
        }
    };
    doc.camera(model.line, size, numbers, distortion).map(Rig::mono)
}
