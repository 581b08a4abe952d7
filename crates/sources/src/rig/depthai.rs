//! The factory calibration of an OAK, as DepthAI writes it in JSON: `cameraData` with a camera for each socket.
//!
//! `x_to = R x_this + t` with `t` in centimetres, where `to` is the camera on `toCameraSocket`. Its documentation.

use super::document::{Document, rigid};
use super::ros;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{Camera, Rig, RigCamera, SourceError};

/// True when a file has its keys.
pub fn is(root: &Node) -> bool {
    root.get("cameraData").and_then(Node::list).is_some()
}

/// The left and the right camera, on sockets 1 and 2; without them the first.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let all = doc.need(&doc.root, "cameraData")?;
    let on = |socket: &str| {
        let mut pairs = all.list().into_iter().flatten().filter_map(Node::list);
        pairs.find_map(|pair| pair.get(1).filter(|_| pair[0].text() == Some(socket)))
    };
    let named = |i: usize, node: &Node, body_from_camera: Se3| -> Result<RigCamera, SourceError> {
        Ok(RigCamera { name: format!("cam{i}"), camera: camera(doc, node)?, body_from_camera })
    };
    let cameras = match (on("1"), on("2")) {
        (Some(left), Some(right)) => {
            let right_from_left = match (relative(doc, left, "2")?, relative(doc, right, "1")?) {
                (Some(t), _) => t,
                (None, Some(t)) => t.inverse(),
                // Both to the colour camera between them.
                (None, None) => match (relative(doc, left, "0")?, relative(doc, right, "0")?) {
                    (Some(left), Some(right)) => right.inverse() * left,
                    _ => {
                        return Err(
                            doc.error(all.line, "does not say how left and right camera stand to each other")
                        );
                    }
                },
            };
            vec![named(0, left, Se3::identity())?, named(1, right, right_from_left.inverse())?]
        }
        (Some(only), None) | (None, Some(only)) => vec![named(0, only, Se3::identity())?],
        (None, None) => match on("0") {
            Some(only) => vec![named(0, only, Se3::identity())?],
            None => return Err(doc.error(all.line, "has no camera on socket 0, 1 or 2")),
        },
    };
    Ok(Rig { cameras, depth: None, imu: None })
}

fn camera(doc: &Document, node: &Node) -> Result<Camera, SourceError> {
    let size = doc.size(node.line, [doc.need_number(node, "width")?, doc.need_number(node, "height")?])?;
    let fisheye = node.get("cameraType").and_then(Node::text) == Some("1");
    let lens = node.get("distortionCoeff");
    let model = if fisheye { "fisheye" } else { "rational_polynomial" };
    ros::matrix_camera(doc, node.get("intrinsicMatrix"), lens, model, size)
}

/// The camera on a socket from this one, where the file says it.
fn relative(doc: &Document, node: &Node, socket: &str) -> Result<Option<Se3>, SourceError> {
    let Some(place) = node.get("extrinsics") else { return Ok(None) };
    if place.get("toCameraSocket").and_then(Node::text) != Some(socket) {
        return Ok(None);
    }
    let (r, t) = (doc.need(place, "rotationMatrix")?, doc.need(place, "translation")?);
    let &[a, b, c, d, e, f, g, h, i] = doc.matrix(r, "rotationMatrix")?.as_slice() else {
        return Err(doc.error(r.line, "rotationMatrix needs 3x3 numbers"));
    };
    let [x, y, z] = ["x", "y", "z"].map(|key| doc.need_number(t, key).map(|cm| 0.01 * cm));
    let m = [a, b, c, x?, d, e, f, y?, g, h, i, z?, 0.0, 0.0, 0.0, 1.0];
    rigid(&m, "rotationMatrix").map(Some).map_err(|e| doc.error(r.line, e.0))
}
