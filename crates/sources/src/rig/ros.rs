//! ROS `camera_info`: the YAML of `camera_calibration` (`image_width`, `camera_matrix`), and a printed
//! `sensor_msgs/CameraInfo` (`width`, `K` or `k`); also what OpenCV's calibration writes (`fisheye_model`), iai_kinect2
//! (`cameraMatrix`), S-PTAM (with a `baseline`) and scripts around OpenCV.
//!
//! Of a pair of files `left.yaml` and `right.yaml` (or `..._left`, `..._right`) the left one gives a stereo rig: the
//! rectification matrices say how the raw cameras stand to the rectified ones, `P[3] = -fx * baseline` how far apart.

use super::document::{CalibrationError, Document};
use super::notation;
use crate::text::read_text;
use cairn_files::yaml::Node;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_sensor::{Camera, Distortion, Rig, RigCamera, SourceError};
use nalgebra::Matrix3;
use std::path::{Path, PathBuf};

/// The names of the matrix of a camera, and of the coefficients of its lens.
const MATRIX: [&str; 6] = ["camera_matrix", "K", "k", "cameraMatrix", "Camera_Matrix", "mtx"];
const LENS: [&str; 11] = [
    "distortion_coefficients",
    "D",
    "d",
    "distortionCoefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "dist_coeff",
    "distortion_coeffs",
    "distortion",
    "dist",
];

fn any<'a>(root: &'a Node, keys: &[&str]) -> Option<&'a Node> {
    keys.iter().find_map(|key| root.get(key))
}

/// True when a file has the keys of a `camera_info`.
pub fn is_camera_info(root: &Node) -> bool {
    any(root, &MATRIX).is_some_and(|k| k.list().is_some() || k.get("data").is_some())
}

/// Tells that a file is that of the right camera of a pair, which is taken alone.
pub fn right_alone(doc: &Document) -> Option<String> {
    let p = doc.matrix(any(&doc.root, &["projection_matrix", "P", "p"])?, "projection_matrix").ok()?;
    let baseline_m = -p.get(3)? / p.first()?;
    (is_camera_info(&doc.root) && baseline_m > 0.0).then(|| {
        format!(
            "is the right camera of a pair ({baseline_m:.3} m from the left one) and taken alone: for both give the file of the \
             left one, with this one beside it under the same name with \"right\" for \"left\""
        )
    })
}

/// The rig of a file, with its partner where there is one; `size` is used where the file has no size.
pub fn rig(doc: &Document, size: Option<[usize; 2]>) -> Result<Rig, SourceError> {
    let left = Info::read(doc, size)?;
    let mut rig = Rig::mono(left.camera);
    if let Some(baseline) = doc.root.get("baseline") {
        let place = Se3::new(So3::identity(), Vec3::new(doc.number(baseline)?, 0.0, 0.0));
        rig.cameras.push(RigCamera { name: "cam1".into(), camera: left.camera, body_from_camera: place });
        return Ok(rig);
    }
    let Some(path) = partner(&doc.path) else { return Ok(rig) };
    let partner = notation::document(&path, &read_text(&path)?)?;
    let Some(partner) = partner.filter(|doc| is_camera_info(&doc.root)) else { return Ok(rig) };
    let right = Info::read(&partner, size)?;
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
    fn read(doc: &Document, size: Option<[usize; 2]>) -> Result<Self, SourceError> {
        let any = |keys: &[&str]| any(&doc.root, keys);
        let model = any(&["distortion_model", "camera_model"]).and_then(Node::text);
        let fisheye = doc.root.get("fisheye_model").and_then(Node::text).is_some_and(|text| text != "0");
        let model = if fisheye { "fisheye" } else { model.unwrap_or("rational_polynomial") };
        let camera = matrix_camera(doc, any(&MATRIX), any(&LENS), model, self::size(doc, size)?)?;
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

/// The size of the images that a file states, or else the given one.
pub fn size(doc: &Document, given: Option<[usize; 2]>) -> Result<[usize; 2], SourceError> {
    let any = |keys: &[&str]| any(&doc.root, keys);
    let sides =
        (any(&["image_width", "width", "image_Width"]), any(&["image_height", "height", "image_Height"]));
    let stated = match (sides, any(&["image_size", "imageSize", "img_size", "resolution"]), given) {
        ((Some(w), Some(h)), ..) => [doc.number(w)?, doc.number(h)?],
        (_, Some(list), _) if list.list().is_some() => doc.array::<2>(list, "the size of the images")?,
        (_, _, Some(size)) => return Ok(size),
        _ => {
            return Err(SourceError::new(
                doc.path.display().to_string(),
                "does not state the size of the images",
                "give the recording as well (--with), whose images have the size, or add image_width and image_height",
            ));
        }
    };
    doc.size(0, stated)
}

/// A camera by its matrix and the coefficients of its lens.
pub fn matrix_camera(
    doc: &Document,
    matrix: Option<&Node>,
    coefficients: Option<&Node>,
    model: &str,
    [width, height]: [usize; 2],
) -> Result<Camera, SourceError> {
    let node = matrix.ok_or_else(|| doc.error(0, "camera_matrix is missing"))?;
    let k = nine(doc, node, "camera_matrix")?;
    let d = coefficients.map_or(Ok(Vec::new()), |d| doc.matrix(d, "distortion_coefficients"))?;
    let line = coefficients.map_or(0, |n| n.line);
    let distortion = lens(model, &d).map_err(|e| doc.error(line, e.0))?;
    let camera = Camera { width, height, fx: k[0], fy: k[4], cx: k[2], cy: k[5], distortion };
    camera.validate().map_err(|e| doc.error(node.line, e.to_string()))?;
    Ok(camera)
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
