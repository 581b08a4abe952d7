//! ROS `camera_info`: the YAML of `camera_calibration` (`image_width`, `camera_matrix`), and a printed
//! `sensor_msgs/CameraInfo` (`width`, `K` or `k`).
//!
//! Of a pair of files `left.yaml` and `right.yaml` (or `..._left`, `..._right`) the left one gives a stereo rig: the
//! rectification matrices say how the raw cameras stand to the rectified ones, `P[3] = -fx * baseline` how far apart.

use super::document::{CalibrationError, Document};
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, Rig, RigCamera, SourceError};
use nalgebra::Matrix3;
use std::path::{Path, PathBuf};

/// True when a file has the keys of a `camera_info`.
pub fn is_camera_info(root: &Node) -> bool {
    let has = |keys: &[&str]| keys.iter().any(|key| root.get(key).is_some());
    has(&["image_width", "width"]) && has(&["camera_matrix", "K", "k"])
}

/// The rig of a file, with its partner where there is one.
pub fn rig(doc: &Document) -> Result<Rig, SourceError> {
    let left = Info::read(doc)?;
    let mut rig = Rig::mono(left.camera);
    let Some(path) = partner(&doc.path) else { return Ok(rig) };
    let partner = Document::parse(&path, &read_text(&path)?)?;
    if !is_camera_info(&partner.root) {
        return Ok(rig);
    }
    let right = Info::read(&partner)?;
    if right.baseline_m <= 0.0 {
        let why = "its projection_matrix has no baseline: P[3] should be -fx times the baseline in metres";
        return Err(partner.error(0, why));
    }
    let rect_from_left = Se3::new(left.rectification, Vec3::zeros());
    let rect_from_right = Se3::new(right.rectification, Vec3::new(right.baseline_m, 0.0, 0.0));
    rig.cameras.push(RigCamera {
        name: "cam1".into(),
        camera: right.camera,
        body_from_camera: rect_from_left.inverse() * rect_from_right,
    });
    Ok(rig)
}

/// The file of the right camera beside that of the left one.
fn partner(left: &Path) -> Option<PathBuf> {
    let name = left.file_name()?.to_str()?;
    let right = name.replacen("left", "right", 1);
    let path = left.with_file_name(&right);
    (right != name && path.is_file()).then_some(path)
}

struct Info {
    camera: Camera,
    /// `x_rectified = R x`.
    rectification: So3,
    /// Distance of the rectified camera from the left one, along +x.
    baseline_m: f64,
}

impl Info {
    fn read(doc: &Document) -> Result<Self, SourceError> {
        let root = &doc.root;
        let any = |keys: &[&str]| keys.iter().find_map(|key| root.get(key));
        let need = |keys: &[&str]| any(keys).ok_or_else(|| doc.error(0, format!("{} is missing", keys[0])));
        let k_node = need(&["camera_matrix", "K", "k"])?;
        let k = nine(doc, k_node, "camera_matrix")?;
        let d = match any(&["distortion_coefficients", "D", "d"]) {
            Some(node) => doc.matrix(node, "distortion_coefficients")?,
            None => Vec::new(),
        };
        let model = any(&["distortion_model", "camera_model"]);
        let distortion = lens(model.and_then(Node::text).unwrap_or("plumb_bob"), &d)
            .map_err(|e| doc.error(model.map_or(0, |n| n.line), e.0))?;
        let camera = Camera {
            width: doc.number(need(&["image_width", "width"])?)? as usize,
            height: doc.number(need(&["image_height", "height"])?)? as usize,
            fx: k[0],
            fy: k[4],
            cx: k[2],
            cy: k[5],
            distortion,
        };
        camera.validate().map_err(|e| doc.error(k_node.line, e.to_string()))?;
        let rectification = match any(&["rectification_matrix", "R", "r"]) {
            None => So3::identity(),
            Some(node) => {
                let r = Matrix3::from_row_slice(&nine(doc, node, "rectification_matrix")?);
                cairn_sensor::check_rotation("rectification_matrix", &r)
                    .map_err(|e| doc.error(node.line, e.to_string()))?;
                So3::from_matrix(&r)
            }
        };
        let p = match any(&["projection_matrix", "P", "p"]) {
            Some(node) => doc.matrix(node, "projection_matrix")?,
            None => Vec::new(),
        };
        let baseline_m = match p.as_slice() {
            [fx, _, _, tx, ..] if *fx > 0.0 => -tx / fx,
            _ => 0.0,
        };
        Ok(Self { camera, rectification, baseline_m })
    }
}

/// OpenCV's order of coefficients: k1 k2 p1 p2 k3 k4 k5 k6, then those of a thin prism and a tilted sensor.
fn lens(model: &str, d: &[f64]) -> Result<Distortion, CalibrationError> {
    let rest_is_zero = |from: usize| d.iter().skip(from).all(|v| *v == 0.0);
    let c = |i: usize| d.get(i).copied().unwrap_or(0.0);
    match model {
        "equidistant" | "fisheye" if d.len() == 4 => Ok(Distortion::Equidistant([c(0), c(1), c(2), c(3)])),
        "plumb_bob" | "rational_polynomial" | "none" | "" if rest_is_zero(0) => Ok(Distortion::None),
        "plumb_bob" | "rational_polynomial" if rest_is_zero(5) => {
            Ok(Distortion::RadialTangential([c(0), c(1), c(2), c(3), c(4)]))
        }
        "rational_polynomial" if rest_is_zero(8) => Ok(Distortion::Rational(std::array::from_fn(c))),
        "plumb_bob" | "rational_polynomial" => Err(CalibrationError(format!(
            "{} coefficients of {model} are more than the lens model has (5, or 8 rational)",
            d.len()
        ))),
        other => Err(CalibrationError(format!(
            "distortion_model \"{other}\" with {} coefficients is not known (plumb_bob, rational_polynomial, equidistant are)",
            d.len()
        ))),
    }
}

fn nine(doc: &Document, node: &Node, what: &str) -> Result<[f64; 9], SourceError> {
    let m = doc.matrix(node, what)?;
    let count = m.len();
    m.try_into().map_err(|_| doc.error(node.line, format!("{what} needs 3x3 numbers, here are {count}")))
}
