//! A pair as OpenCV's `stereo_calib` writes it: `intrinsics.yml` with `M1`, `D1`, `M2`, `D2`, and `R`, `T` in `extrinsics.yml` beside it
//! or in the same file. `x_right = R x_left + T`, `T` in the unit of the squares of the board.

use super::document::{Document, rigid};
use super::{notation, ros};
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::Se3;
use cairn_sensor::{Rig, RigCamera, SourceError};

/// Names of matrix and lens of both cameras.
const NAMES: [[&str; 4]; 4] = [
    ["M1", "D1", "M2", "D2"],
    ["K1", "D1", "K2", "D2"],
    ["cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"],
    ["camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right"],
];

fn names(root: &Node) -> Option<&'static [&'static str; 4]> {
    NAMES.iter().find(|[left, _, right, _]| root.get(left).is_some() && root.get(right).is_some())
}

/// True when a file has the matrices of two cameras.
pub fn is_pair(root: &Node) -> bool {
    names(root).is_some()
}

/// Both cameras; `size` is used where the file has no size.
pub fn pair(doc: &Document, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let [left, left_lens, right, right_lens] =
        names(&doc.root).ok_or_else(|| doc.error(0, "has no M1 and M2"))?;
    let size = ros::size(doc, size)?;
    let camera = |matrix: &str, lens: &str| {
        ros::matrix_camera(doc, doc.root.get(matrix), doc.root.get(lens), "rational_polynomial", size)
    };
    let mut rig = Rig::mono(camera(left, left_lens)?);
    let beside = beside(doc)?;
    let placed = [Some(doc), beside.as_ref()].into_iter().flatten().find(|doc| doc.root.get("T").is_some());
    let place = placed.ok_or_else(|| {
        doc.error(0, "has no R and T between its cameras, nor has an extrinsics.yml beside it")
    })?;
    let body_from_camera = right_from_left(place)?.inverse();
    rig.cameras.push(RigCamera { name: "cam1".into(), camera: camera(right, right_lens)?, body_from_camera });
    Ok(rig)
}

fn beside(doc: &Document) -> Result<Option<Document>, SourceError> {
    let names = ["extrinsics.yml", "extrinsics.yaml", "extrinsics.xml"];
    let Some(path) = names.iter().map(|name| doc.path.with_file_name(name)).find(|path| path.is_file())
    else {
        return Ok(None);
    };
    notation::document(&path, &read_text(&path)?)
}

fn right_from_left(doc: &Document) -> Result<Se3, SourceError> {
    let (r, t) = (doc.need(&doc.root, "R")?, doc.need(&doc.root, "T")?);
    let (&[a, b, c, d, e, f, g, h, i], &[x, y, z]) =
        (doc.matrix(r, "R")?.as_slice(), doc.matrix(t, "T")?.as_slice())
    else {
        return Err(doc.error(r.line, "R needs 3x3 numbers and T three"));
    };
    rigid(&[a, b, c, x, d, e, f, y, g, h, i, z, 0.0, 0.0, 0.0, 1.0], "R").map_err(|e| doc.error(r.line, e.0))
}
