//! `transforms.json` of nerfstudio with the points it may begin from (docs.nerf.studio/quickstart/data_conventions.html).
//!
//! A camera there has x to the right, y up and z backwards. Nothing is applied to the world: it is that of the map.

use super::model::{Model, View};
use super::pinhole::Pinhole;
use serde::Serialize;
use std::fmt::Write;

/// The points, beside `transforms.json`.
const POINTS: &str = "points.ply";

#[derive(Serialize)]
struct Transforms<'a> {
    camera_model: &'static str,
    /// Where all frames have the same.
    #[serde(flatten)]
    intrinsics: Option<Intrinsics>,
    applied_transform: [[f64; 4]; 3],
    ply_file_path: &'static str,
    frames: Vec<Frame<'a>>,
}

#[derive(Serialize)]
struct Intrinsics {
    fl_x: f64,
    fl_y: f64,
    cx: f64,
    cy: f64,
    w: usize,
    h: usize,
}

#[derive(Serialize)]
struct Frame<'a> {
    file_path: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    mask_path: Option<&'a str>,
    /// Where frames differ.
    #[serde(flatten)]
    intrinsics: Option<Intrinsics>,
    transform_matrix: [[f64; 4]; 4],
}

/// The files by name; `folder` has the pictures, `mask` says which of their pixels are of the world.
pub fn files(model: &Model, folder: &str, mask: Option<&str>) -> [(&'static str, String); 2] {
    let shared = match &model.cameras[..] {
        [one] => Some(intrinsics(one)),
        _ => None,
    };
    let frame = |view: &View| Frame {
        file_path: format!("{folder}/{}", view.name()),
        mask_path: mask,
        intrinsics: if shared.is_some() { None } else { Some(intrinsics(&model.cameras[view.camera])) },
        transform_matrix: world_from_camera(view),
    };
    let transforms = Transforms {
        camera_model: "OPENCV",
        frames: model.views.iter().map(frame).collect(),
        intrinsics: shared,
        applied_transform: [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
        ply_file_path: POINTS,
    };
    // Numbers and names to memory: this does not fail.
    let json = serde_json::to_string_pretty(&transforms).unwrap_or_default();
    [("transforms.json", json + "\n"), (POINTS, ply(model))]
}

fn intrinsics(c: &Pinhole) -> Intrinsics {
    Intrinsics { fl_x: c.focal.x, fl_y: c.focal.y, cx: c.centre.x, cy: c.centre.y, w: c.width, h: c.height }
}

/// Rows of the matrix; y and z of the camera are turned around.
fn world_from_camera(view: &View) -> [[f64; 4]; 4] {
    let m = view.world_from_camera.matrix();
    [0, 1, 2, 3].map(|row| [m[(row, 0)], -m[(row, 1)], -m[(row, 2)], m[(row, 3)]])
}

fn ply(model: &Model) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {}\n", model.points.len());
    for name in ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue"] {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "property {name}");
    }
    text += "end_header\n";
    for point in &model.points {
        let (p, v) = (point.position, point.luminance);
        let _ = writeln!(text, "{} {} {} {v} {v} {v}", p.x, p.y, p.z);
    }
    text
}
