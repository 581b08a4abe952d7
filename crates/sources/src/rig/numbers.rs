//! Cameras of bare numbers: one line `fx fy cx cy` with the coefficients of a lens behind it (DROID-SLAM), a matrix of 3x3 or 4x4
//! (3DMatch, ScanNet), and lists under a name (MASt3R-SLAM's `calibration`, R3LIVE's `camera_intrinsic`).

use super::document::{CalibrationError, Document, lens};
use crate::text::{data_lines, fields};
use cairn_files::yaml::{Node, Value};
use cairn_sensor::{Camera, Distortion, Rig, SourceError};
use std::path::Path;

/// True when a text has nothing but the numbers of a camera.
pub fn is(text: &str) -> bool {
    parts(text).is_some()
}

/// Focal lengths and centre, and the coefficients of the lens.
fn parts(text: &str) -> Option<([f64; 4], Vec<f64>)> {
    let lines = data_lines(text).take(5);
    let number = |word: &str| word.parse().ok().filter(|v: &f64| v.is_finite());
    let rows: Vec<Vec<f64>> =
        lines.map(|(_, line)| fields(line).map(number).collect::<Option<_>>()).collect::<Option<_>>()?;
    let (pinhole, c) = match rows.iter().map(Vec::as_slice).collect::<Vec<_>>()[..] {
        [&[fx, fy, cx, cy, ref c @ ..]] if matches!(c.len(), 0 | 4 | 5 | 8) => ([fx, fy, cx, cy], c.to_vec()),
        [&[fx, _, cx], &[0.0, fy, cy], &[0.0, 0.0, 1.0]]
        | [&[fx, _, cx, 0.0], &[0.0, fy, cy, 0.0], &[0.0, 0.0, 1.0, 0.0], &[0.0, 0.0, 0.0, 1.0]] => {
            ([fx, fy, cx, cy], Vec::new())
        }
        _ => return None,
    };
    // No pose or quaternion has focal lengths.
    pinhole.iter().all(|v| *v > 10.0).then_some((pinhole, c))
}

/// The camera; such a file never states the size of its images.
pub fn rig(path: &Path, text: &str, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let wrong = |why: String, cure: &str| SourceError::new(path.display().to_string(), why, cure);
    let (pinhole, c) = parts(text).ok_or_else(|| wrong("is no camera".into(), "give fx fy cx cy"))?;
    let cure = "give the recording as well (--with), whose images have the size, or write a rig.toml";
    let size = size.ok_or_else(|| wrong("does not state the size of the images".into(), cure))?;
    let camera = camera(size, pinhole, &c).map_err(|e| wrong(e.to_string(), "correct the numbers"))?;
    Ok(Rig::mono(camera))
}

fn camera(
    [width, height]: [usize; 2],
    [fx, fy, cx, cy]: [f64; 4],
    c: &[f64],
) -> Result<Camera, CalibrationError> {
    let distortion = if c.iter().all(|v| *v == 0.0) { Distortion::None } else { lens("radtan", c)? };
    let camera = Camera { width, height, fx, fy, cx, cy, distortion };
    camera.validate()?;
    Ok(camera)
}

/// The mapping with such lists: the root, or one below it.
fn node(root: &Node) -> Option<&Node> {
    let has = |node: &&Node| {
        let matrix = node.get("camera_intrinsic").is_some() && node.get("image_width").is_some();
        matrix || (node.get("calibration").and_then(Node::list).is_some() && node.get("width").is_some())
    };
    let below = match &root.value {
        Value::Map(entries) => entries.as_slice(),
        _ => &[],
    };
    std::iter::once(root).chain(below.iter().map(|(_, node)| node)).find(has)
}

/// True when a file has such lists.
pub fn is_listed(root: &Node) -> bool {
    node(root).is_some()
}

/// The camera of such lists.
pub fn listed(doc: &Document) -> Result<Rig, SourceError> {
    let node = node(&doc.root).ok_or_else(|| doc.error(0, "has no camera"))?;
    let side = |keys: [&str; 2]| match node.get(keys[0]) {
        Some(node) => doc.number(node),
        None => doc.need_number(node, keys[1]),
    };
    let size = doc.size(node.line, [side(["image_width", "width"])?, side(["image_height", "height"])?])?;
    let (line, pinhole, c) = if let Some(matrix) = node.get("camera_intrinsic") {
        let k = doc.array::<9>(matrix, "camera_intrinsic")?;
        let lens = node.get("camera_dist_coeffs").map_or(Ok(Vec::new()), |node| doc.numbers(node))?;
        (matrix.line, [k[0], k[4], k[2], k[5]], lens)
    } else {
        let list = doc.need(node, "calibration")?;
        let all = doc.numbers(list)?;
        let &[fx, fy, cx, cy, ref c @ ..] = all.as_slice() else {
            return Err(
                doc.error(list.line, "calibration needs fx, fy, cx, cy and the coefficients of the lens")
            );
        };
        (list.line, [fx, fy, cx, cy], c.to_vec())
    };
    Ok(Rig::mono(camera(size, pinhole, &c).map_err(|e| doc.error(line, e.0))?))
}
