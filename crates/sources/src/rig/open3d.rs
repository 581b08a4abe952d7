//! Open3D's `camera_intrinsic.json`: `width`, `height`, and `intrinsic_matrix` by columns.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_sensor::{Distortion, Rig, SourceError};

/// True when a file has the matrix.
pub fn is(root: &Node) -> bool {
    root.get("intrinsic_matrix").is_some() && root.get("width").is_some()
}

/// The camera.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let size = doc.size(0, [doc.need_number(&doc.root, "width")?, doc.need_number(&doc.root, "height")?])?;
    let node = doc.need(&doc.root, "intrinsic_matrix")?;
    let k = doc.array::<9>(node, "intrinsic_matrix")?;
    Ok(Rig::mono(doc.camera(node.line, size, [k[0], k[4], k[6], k[7]], Distortion::None)?))
}
