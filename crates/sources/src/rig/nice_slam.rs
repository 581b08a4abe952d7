//! Depth cameras of NICE-SLAM and those after it (`cam:` with `H`, `W`, `png_depth_scale`; also in the file that `inherit_from`
//! names), and of Replica's `cam_params.json` (`camera` with `w`, `h`, `scale`).

use super::document::Document;
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{DepthSensor, Distortion, Rig, SourceError};

/// Files that inherit from each other at most.
const MOST: usize = 8;

/// True when a file has such a camera, or names the file that it inherits from.
pub fn is(root: &Node) -> bool {
    camera(root).is_some() || root.get("inherit_from").is_some()
}

fn camera(root: &Node) -> Option<&Node> {
    ["cam", "camera"].into_iter().filter_map(|key| root.get(key)).find(|n| n.get("fx").is_some())
}

/// The camera with depth registered to it.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    match camera(&doc.root) {
        Some(node) => of_node(doc, node),
        None => inherited(doc, MOST),
    }
}

/// The camera of the file that this one inherits from: its path is that from a folder above.
fn inherited(doc: &Document, most: usize) -> Result<Rig, SourceError> {
    let named = doc.need(&doc.root, "inherit_from")?;
    let file = named.text().unwrap_or_default();
    let path = doc.path.ancestors().skip(1).map(|folder| folder.join(file)).find(|path| path.is_file());
    let path = path.filter(|_| most > 0).ok_or_else(|| {
        let why = format!("has no camera, and what it inherits from, {file}, is in no folder above it");
        doc.error(named.line, why)
    })?;
    let above = Document::parse(&path, &read_text(&path)?)?;
    match camera(&above.root) {
        Some(node) => of_node(&above, node),
        None => inherited(&above, most - 1),
    }
}

fn of_node(doc: &Document, node: &Node) -> Result<Rig, SourceError> {
    let either = |keys: [&str; 2]| {
        let found = keys.iter().find_map(|key| node.get(key));
        doc.number(found.ok_or_else(|| doc.error(node.line, format!("{} is missing", keys[0])))?)
    };
    let size = doc.size(node.line, [either(["W", "w"])?, either(["H", "h"])?])?;
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
