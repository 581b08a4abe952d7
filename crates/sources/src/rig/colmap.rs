//! The camera of a COLMAP model: `cameras.txt`, lines of `CAMERA_ID MODEL WIDTH HEIGHT PARAMS`.
//!
//! The centre of COLMAP's first pixel is at 0.5, 0.5, here at 0, 0. Schönberger and Frahm, "Structure-from-motion revisited"
//! (2016), and the documentation of its models.

use crate::text::{data_lines, fields, place};
use cairn_sensor::{Camera, Distortion, Rig, SourceError};
use std::path::Path;

const MODELS: [&str; 11] = [
    "SIMPLE_PINHOLE",
    "PINHOLE",
    "SIMPLE_RADIAL",
    "RADIAL",
    "OPENCV",
    "FULL_OPENCV",
    "OPENCV_FISHEYE",
    "SIMPLE_RADIAL_FISHEYE",
    "RADIAL_FISHEYE",
    "FOV",
    "SIMPLE_DIVISION",
];

/// True when the first line of data is a camera of COLMAP.
pub fn is(text: &str) -> bool {
    let model = data_lines(text).next().and_then(|(_, line)| fields(line).nth(1));
    model.is_some_and(|model| MODELS.contains(&model) || model == "THIN_PRISM_FISHEYE")
}

/// The camera; of several none can be chosen.
pub fn rig(path: &Path, text: &str) -> Result<Rig, SourceError> {
    let lines: Vec<(usize, &str)> = data_lines(text).collect();
    let &[(line, content)] = &lines[..] else {
        let why = format!("holds {} cameras of COLMAP", lines.len());
        return Err(SourceError::new(
            path.display().to_string(),
            why,
            "give a file with the line of one of them",
        ));
    };
    let wrong = |why: String| SourceError::new(place(path, line), why, "correct the line");
    let words: Vec<&str> = fields(content).collect();
    let numbers: Option<Vec<f64>> = words[2..].iter().map(|w| w.parse().ok()).collect();
    let numbers = numbers.filter(|n| n.len() > 2 && n.iter().all(|v: &f64| v.is_finite()));
    let numbers = numbers.ok_or_else(|| wrong("is not CAMERA_ID MODEL WIDTH HEIGHT PARAMS".into()))?;
    let (size, params) = numbers.split_at(2);
    let Some(([fx, fy, cx, cy], distortion)) = lens(words[1], params) else {
        let known = MODELS.join(", ");
        return Err(wrong(format!(
            "model {} with {} parameters is not known ({known} are, with those that COLMAP gives them)",
            words[1],
            params.len()
        )));
    };
    let whole = |side: f64| side.fract() == 0.0 && (0.0..1e9).contains(&side);
    if !size.iter().all(|side| whole(*side)) {
        return Err(wrong("WIDTH and HEIGHT are no whole numbers".into()));
    }
    let (width, height) = (size[0] as usize, size[1] as usize);
    let camera = Camera { width, height, fx, fy, cx: cx - 0.5, cy: cy - 0.5, distortion };
    camera.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(Rig::mono(camera))
}

/// Focal lengths and centre, and the lens.
fn lens(model: &str, params: &[f64]) -> Option<([f64; 4], Distortion)> {
    use Distortion::{Division, Equidistant, Fov, RadialTangential, Rational};
    Some(match (model, params) {
        ("SIMPLE_PINHOLE", &[f, x, y]) => ([f, f, x, y], Distortion::None),
        ("PINHOLE", &[fx, fy, x, y]) => ([fx, fy, x, y], Distortion::None),
        ("SIMPLE_RADIAL", &[f, x, y, k]) => ([f, f, x, y], RadialTangential([k, 0.0, 0.0, 0.0, 0.0])),
        ("RADIAL", &[f, x, y, k1, k2]) => ([f, f, x, y], RadialTangential([k1, k2, 0.0, 0.0, 0.0])),
        ("OPENCV", &[fx, fy, x, y, k1, k2, p1, p2]) => {
            ([fx, fy, x, y], RadialTangential([k1, k2, p1, p2, 0.0]))
        }
        ("FULL_OPENCV", &[fx, fy, x, y, k1, k2, p1, p2, k3, k4, k5, k6]) => {
            ([fx, fy, x, y], Rational([k1, k2, p1, p2, k3, k4, k5, k6]))
        }
        ("OPENCV_FISHEYE", &[fx, fy, x, y, k1, k2, k3, k4]) => {
            ([fx, fy, x, y], Equidistant([k1, k2, k3, k4]))
        }
        ("SIMPLE_RADIAL_FISHEYE", &[f, x, y, k]) => ([f, f, x, y], Equidistant([k, 0.0, 0.0, 0.0])),
        ("RADIAL_FISHEYE", &[f, x, y, k1, k2]) => ([f, f, x, y], Equidistant([k1, k2, 0.0, 0.0])),
        ("FOV", &[fx, fy, x, y, w]) => ([fx, fy, x, y], Fov(w)),
        ("SIMPLE_DIVISION", &[f, x, y, k]) => ([f, f, x, y], Division(k)),
        _ => return None,
    })
}
