//! Depth cameras of NICE-SLAM and those after it (`cam:` with `H`, `W`, `png_depth_scale`), and of Replica's
//! `cam_params.json` (`camera` with `w`, `h`, `scale`).

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{DepthSensor, Distortion, Rig, SourceError};

/// True when a file has such a camera.
pub fn is(root: &Node) -> bool {
    node(root).is_some()
}

fn node(root: &Node) -> Option<&Node> {
    ["cam", "camera"].into_iter().filter_map(|key| root.get(key)).find(|n| n.get("fx").is_some())
}

/// The camera with depth registered to it.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let Some(node) = node(&doc.root) else { return Err(doc.error(0, "has no camera")) };
    let either = |keys: [&str; 2]| {
        let found = keys.iter().find_map(|key| node.get(key));
        doc.number(found.ok_or_else(|| doc.error(node.line, format!("{} is missing", keys[0])))?)
    };
    let size = [either(["W", "w"])? as usize, either(["H", "h"])? as usize];
    let [fx, fy, cx, cy] = ["fx", "fy", "cx", "cy"].map(|key| doc.need_number(node, key));
    let distortion = match node.get("distortion") {
        Some(c) => doc.distortion(c.line, "radtan", &doc.numbers(c)?)?,
        None => Distortion::None,
    };
    let camera = doc.camera(node.line, size, [fx?, fy?, cx?, cy?], distortion)?;
    let scale = either(["png_depth_scale", "scale"])?;
    if scale <= 0.0 {
        return Err(doc.error(node.line, format!("png_depth_scale is {scale}")));
    }
    let depth = DepthSensor {
        camera,
        body_from_depth: Se3::identity(),
        metres_per_unit: 1.0 / scale,
        registered: true,
    };
    Ok(Rig { depth: Some(depth), ..Rig::mono(camera) })
}
