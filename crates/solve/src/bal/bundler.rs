//! Bundler's text: counts, then of each camera focal length, distortion, rotation matrix and translation, and of each point
//! its position, colour and views. The camera is that of BAL.
//!
//! Source: Snavely, "Bundler v0.4 user's manual" (2010), section "Output format".

use super::words::Words;
use super::{Bal, BalCamera, BalObservation};
use crate::text::TextError;
use cairn_geometry::{Mat3, Se3, So3, Vec2};

/// Reads the text after its first line, a comment. Cameras that were not found have a focal length of zero; they and their
/// views are left out.
pub fn read(words: &mut Words) -> Result<Bal, TextError> {
    let cameras = words.whole("the number of cameras", u32::MAX)?;
    let points = words.whole("the number of points", u32::MAX)?;
    let mut bal = Bal::default();
    let mut places = Vec::new();
    for _ in 0..cameras {
        let camera = camera(words)?;
        places.push((camera.focal > 0.0).then_some(bal.cameras.len() as u32));
        bal.cameras.extend((camera.focal > 0.0).then_some(camera));
    }
    for _ in 0..points {
        let (position, _colour) = (words.vec3("a point")?, words.vec3("the colour of a point")?);
        let views = words.whole("the number of views of a point", u32::MAX)?;
        let point = bal.points.len() as u32;
        for _ in 0..views {
            let camera = words.whole("the camera of a view", cameras)?;
            let _feature = words.number("the feature of a view")?;
            let pixel = Vec2::new(words.number("x of a view")?, words.number("y of a view")?);
            if let Some(Some(camera)) = places.get(camera as usize).copied() {
                bal.observations.push(BalObservation { camera, point, pixel });
            }
        }
        bal.points.push(position);
    }
    Ok(bal)
}

fn camera(words: &mut Words) -> Result<BalCamera, TextError> {
    let [focal, k1, k2] =
        ["a focal length", "k1 of a camera", "k2 of a camera"].map(|what| words.number(what));
    let (focal, k1, k2) = (focal?, k1?, k2?);
    let mut rotation = Mat3::zeros();
    for r in 0..3 {
        rotation.set_row(r, &words.vec3("the rotation of a camera")?.transpose());
    }
    let translation = words.vec3("the translation of a camera")?;
    let off = (rotation.transpose() * rotation - Mat3::identity()).norm();
    if focal > 0.0 && !(off < 1e-3 && rotation.determinant() > 0.0) {
        return Err(words.here(TextError::new(0, "the matrix of a camera is no rotation")));
    }
    Ok(BalCamera { camera_from_world: Se3::new(So3::from_matrix(&rotation), translation), focal, k1, k2 })
}
