//! Cameras of DSO and those after it (LDSO, DM-VIO, the TUM monocular recordings): four lines of text.
//!
//! The first has a model's name, focal lengths, centre and lens, the second the size of the images. What the images are undistorted to
//! (lines three and four) is of no use here, as they are taken as they are. Engel, Koltun and Cremers, "Direct sparse
//! odometry" (2018), and its documentation.

use super::document::lens;
use crate::text::{data_lines, fields, numbers, place};
use cairn_sensor::{Camera, Distortion, Rig, SourceError};
use std::path::Path;

/// True when the text has the first two lines of such a camera.
pub fn is(text: &str) -> bool {
    parts(text).is_some()
}

/// The model's name, in small letters; its numbers; width and height.
fn parts(text: &str) -> Option<(String, Vec<f64>, [f64; 2])> {
    let mut lines = data_lines(text);
    let mut words = fields(lines.next()?.1).peekable();
    let named = words.next_if(|word| word.parse::<f64>().is_err());
    let model = named.map(str::to_ascii_lowercase).unwrap_or_default();
    let known = ["", "pinhole", "fov", "radtan", "equidistant", "kannalabrandt"];
    let values: Vec<f64> = words.map(|word| word.parse().ok()).collect::<Option<_>>()?;
    let size = numbers::<2>(fields(lines.next()?.1))?;
    let whole = size.iter().all(|side| side.fract() == 0.0 && (1.0..1e6).contains(side));
    (known.contains(&model.as_str()) && matches!(values.len(), 5 | 8) && whole)
        .then_some((model, values, size))
}

/// The camera. With a centre below 1, focal lengths and centre are shares of the sides, from the corner of the first pixel.
pub fn rig(path: &Path, text: &str) -> Result<Rig, SourceError> {
    let wrong = |why: String| SourceError::new(place(path, 1), why, "correct the line");
    let (model, values, [w, h]) = parts(text).ok_or_else(|| wrong("is no camera of DSO".into()))?;
    let (pinhole, c) = values.split_at(4);
    let name = match (model.as_str(), c.len()) {
        ("pinhole", _) => "none",
        ("" | "fov", 1) => "fov",
        ("" | "radtan", 4) => "radtan",
        ("equidistant" | "kannalabrandt", 4) => "equidistant",
        _ => {
            return Err(wrong(format!(
                "model {model} with {} numbers after the centre is not known",
                c.len()
            )));
        }
    };
    let distortion = match name {
        "fov" if c[0] == 0.0 => Distortion::None,
        _ => lens(name, c).map_err(|e| wrong(e.to_string()))?,
    };
    let [fx, fy, cx, cy] = match *pinhole {
        [fx, fy, cx, cy] if cx < 1.0 && cy < 1.0 => [fx * w, fy * h, cx * w - 0.5, cy * h - 0.5],
        [fx, fy, cx, cy] => [fx, fy, cx, cy],
        _ => return Err(wrong("needs fx, fy, cx and cy".into())),
    };
    let camera = Camera { width: w as usize, height: h as usize, fx, fy, cx, cy, distortion };
    camera.validate().map_err(|e| wrong(e.to_string()))?;
    Ok(Rig::mono(camera))
}
