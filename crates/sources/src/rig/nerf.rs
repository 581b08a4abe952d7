//! The camera of a `transforms.json` (instant-ngp, nerfstudio, Polycam, Record3D's export): `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1`.
//!
//! The centre of the first pixel is at 0.5, 0.5, as of COLMAP, whose cameras it takes over.

use super::document::Document;
use cairn_files::yaml::Node;
use cairn_sensor::{Rig, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("fl_x").is_some() || root.get("camera_angle_x").is_some()
}

/// The camera.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let root = &doc.root;
    let need = |key: &str| doc.need_number(root, key);
    let or_zero = |key: &str| root.get(key).map_or(Ok(0.0), |node| doc.number(node));
    let (w, h) = (need("w")?, need("h")?);
    let fx = match root.get("fl_x") {
        Some(node) => doc.number(node)?,
        None => 0.5 * w / (0.5 * need("camera_angle_x")?).tan(),
    };
    let fy = root.get("fl_y").map_or(Ok(fx), |node| doc.number(node))?;
    let centre = |key: &str, side: f64| root.get(key).map_or(Ok(0.5 * side), |node| doc.number(node));
    let pinhole = [fx, fy, centre("cx", w)? - 0.5, centre("cy", h)? - 0.5];
    let model = root.get("camera_model").and_then(Node::text).unwrap_or("OPENCV");
    let (lens, keys) = match model {
        "OPENCV_FISHEYE" => ("equidistant", ["k1", "k2", "k3", "k4"]),
        "OPENCV" | "PINHOLE" | "SIMPLE_PINHOLE" | "SIMPLE_RADIAL" | "RADIAL" => {
            ("radtan", ["k1", "k2", "p1", "p2"])
        }
        other => {
            return Err(doc.error(
                0,
                format!("camera_model \"{other}\" is not known (OPENCV, OPENCV_FISHEYE, PINHOLE are)"),
            ));
        }
    };
    let mut c = keys.into_iter().map(or_zero).collect::<Result<Vec<f64>, _>>()?;
    if lens == "radtan" {
        c.push(or_zero("k3")?);
    }
    let lens = if c.iter().all(|v| *v == 0.0) && lens == "radtan" { ("none", Vec::new()) } else { (lens, c) };
    let camera = doc.camera(0, doc.size(0, [w, h])?, pinhole, doc.distortion(0, lens.0, &lens.1)?)?;
    Ok(Rig::mono(camera))
}
