//! Depth cameras of NICE-SLAM and those after it (`cam:` with `H`, `W`, `png_depth_scale`; also in the file that `inherit_from`
//! names), of SplaTAM (`camera_params:`), of MonoGS (`Dataset: Calibration:` with `depth_scale`), and of Replica's
//! `cam_params.json` (`camera` with `w`, `h`, `scale`).

use super::document::Document;
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{DepthSensor, Distortion, Rig, SourceError};

/// Files that inherit from each other at most.
const MOST: usize = 8;

/// What the depth of a metre is called.
const SCALE: [&str; 3] = ["png_depth_scale", "scale", "depth_scale"];

/// True when a file has such a camera, or names the file that it inherits from.
pub fn is(root: &Node) -> bool {
    camera(root).is_some() || root.get("inherit_from").is_some()
}

fn camera(root: &Node) -> Option<&Node> {
    let of_monogs = root.get("Dataset").and_then(|n| n.get("Calibration"));
    let nodes = ["cam", "camera", "camera_params"].into_iter().filter_map(|key| root.get(key));
    nodes.chain(of_monogs).find(|n| n.get("fx").is_some())
}

/// The camera with depth registered to it. What the file does not state of it is that of the file that it inherits from.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let above = inherited(doc, MOST)?;
    let all: Vec<&Document> = std::iter::once(doc).chain(&above).collect();
    of_files(&all)
}

/// The files that complete the camera of this one, the nearest first: a path is that from a folder above.
fn inherited(doc: &Document, most: usize) -> Result<Vec<Document>, SourceError> {
    let complete = camera(&doc.root).is_some_and(|node| SCALE.iter().any(|key| node.get(key).is_some()));
    let Some(named) = doc.root.get("inherit_from").filter(|_| !complete) else { return Ok(Vec::new()) };
    let file = named.text().unwrap_or_default();
    let path = doc.path.ancestors().skip(1).map(|folder| folder.join(file)).find(|path| path.is_file());
    let path = path.filter(|_| most > 0).ok_or_else(|| {
        let why = format!("has no whole camera, and what it inherits from, {file}, is in no folder above it");
        doc.error(named.line, why)
    })?;
    let above = Document::parse(&path, &read_text(&path)?)?;
    let further = inherited(&above, most - 1)?;
    Ok(std::iter::once(above).chain(further).collect())
}

/// The camera of a file and those above it: each of its values is the nearest.
fn of_files(all: &[&Document]) -> Result<Rig, SourceError> {
    let doc = all[0];
    let line = camera(&doc.root).map_or(0, |node| node.line);
    let nearest = |keys: &[&str]| {
        all.iter().find_map(|doc| {
            let node = camera(&doc.root)?;
            Some((*doc, keys.iter().find_map(|key| node.get(key))?))
        })
    };
    let need = |keys: &[&str]| match nearest(keys) {
        Some((doc, node)) => doc.number(node),
        None => Err(doc.error(line, format!("{} is missing", keys[0]))),
    };
    let size = doc.size(
        line,
        [need(&["W", "w", "width", "image_width"])?, need(&["H", "h", "height", "image_height"])?],
    )?;
    let pinhole = [need(&["fx"])?, need(&["fy"])?, need(&["cx"])?, need(&["cy"])?];
    let is_distorted = nearest(&["distorted"])
        .and_then(|(_, node)| node.text())
        .is_some_and(|t| t.eq_ignore_ascii_case("true"));
    let distortion = match nearest(&["distortion"]) {
        Some((doc, c)) => doc.distortion(c.line, "radtan", &doc.numbers(c)?)?,
        None if is_distorted => {
            let [k1, k2, p1, p2, k3] = ["k1", "k2", "p1", "p2", "k3"].map(|key| need(&[key]));
            Distortion::RadialTangential([k1?, k2?, p1?, p2?, k3?])
        }
        None => Distortion::None,
    };
    let camera = doc.camera(line, size, pinhole, distortion)?;
    let scale = need(&SCALE)?;
    if scale <= 0.0 {
        return Err(doc.error(line, format!("png_depth_scale is {scale}")));
    }
    let depth = DepthSensor {
        camera,
        body_from_depth: Se3::identity(),
        metres_per_unit: 1.0 / scale,
        registered: true,
    };
    Ok(Rig { depth: Some(depth), ..Rig::mono(camera) })
}
