//! COLMAP's text model: `cameras.txt`, `images.txt`, `points3D.txt` (colmap.github.io/format.html).
//!
//! Cameras look along +z with y down, as here. An image's pose is that of the world in the camera; all numbers begin at 1.

use super::model::Model;
use std::fmt::Write;

/// The files by name.
pub fn files(model: &Model) -> [(&'static str, String); 3] {
    [("cameras.txt", cameras(model)), ("images.txt", images(model)), ("points3D.txt", points(model))]
}

// Writing to a string cannot fail.

fn cameras(model: &Model) -> String {
    let mut text = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, FX, FY, CX, CY\n");
    for (i, c) in model.cameras.iter().enumerate() {
        let (w, h, f, p) = (c.width, c.height, c.focal, c.centre);
        let _ = writeln!(text, "{} PINHOLE {w} {h} {} {} {} {}", i + 1, f.x, f.y, p.x, p.y);
    }
    text
}

fn images(model: &Model) -> String {
    let unit = if model.metric { "Lengths are metres." } else { "Lengths have no unit." };
    let mut text = format!(
        "# {unit}\n# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# X, Y, POINT3D_ID of each feature\n"
    );
    for (i, view) in model.views.iter().enumerate() {
        let pose = view.world_from_camera.inverse();
        let (q, t) = (pose.rotation.quaternion(), pose.translation);
        let _ = write!(text, "{} {} {} {} {} {} {} {}", i + 1, q.w, q.i, q.j, q.k, t.x, t.y, t.z);
        let _ = writeln!(text, " {} {}", view.camera + 1, view.name());
        let features = view.features.iter().map(|(px, point)| {
            let point = point.map_or_else(|| "-1".to_owned(), |i| (i + 1).to_string());
            format!("{} {} {point}", px.x, px.y)
        });
        text += &features.collect::<Vec<_>>().join(" ");
        text.push('\n');
    }
    text
}

fn points(model: &Model) -> String {
    let mut text =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    for (i, point) in model.points.iter().enumerate() {
        let (p, v) = (point.position, point.luminance);
        let _ = write!(text, "{} {} {} {} {v} {v} {v} {}", i + 1, p.x, p.y, p.z, point.error_px);
        for (view, feature) in &point.track {
            let _ = write!(text, " {} {feature}", view + 1);
        }
        text.push('\n');
    }
    text
}
