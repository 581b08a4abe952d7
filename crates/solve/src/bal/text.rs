//! BAL text: counts, observations, then nine numbers of each camera and three of each point.

use super::words::Words;
use super::{Bal, BalCamera, BalObservation};
use crate::text::{TextError, shown};
use cairn_geometry::{Se3, So3, Vec2};
use std::fmt::Write;

/// Reads a BAL text, or one of Bundler, which begins with `# Bundle file`.
///
/// # Errors
/// With the line: counts that are not whole, indices beyond them, what is missing or too much, numbers that are not finite.
/// Memory grows with the text, whatever its counts say.
pub fn read(text: &str) -> Result<Bal, TextError> {
    let mut words = Words::new(text);
    if text.starts_with('#') {
        words.skip_line();
        if !text.starts_with("# Bundle file") {
            return Err(TextError::new(
                1,
                format!("begins with a comment, \"{}\"", shown(text.lines().next().unwrap_or_default())),
            ));
        }
        let bal = super::bundler::read(&mut words)?;
        return words.ended(bal);
    }
    let cameras = words.whole("the number of cameras", u32::MAX)?;
    let points = words.whole("the number of points", u32::MAX)?;
    let observations = words.whole("the number of observations", u32::MAX)?;
    let mut bal = Bal::default();
    for _ in 0..observations {
        let camera = words.whole("the camera of an observation", cameras)?;
        let point = words.whole("the point of an observation", points)?;
        let pixel = Vec2::new(words.number("x of a pixel")?, words.number("y of a pixel")?);
        bal.observations.push(BalObservation { camera, point, pixel });
    }
    for _ in 0..cameras {
        let rotation = words.vec3("the rotation of a camera")?;
        let translation = words.vec3("the translation of a camera")?;
        bal.cameras.push(BalCamera {
            camera_from_world: Se3::new(So3::exp(&rotation), translation),
            focal: words.number("a focal length")?,
            k1: words.number("k1 of a camera")?,
            k2: words.number("k2 of a camera")?,
        });
    }
    for _ in 0..points {
        bal.points.push(words.vec3("a point")?);
    }
    words.ended(bal)
}

/// The text of a problem; numbers keep every digit.
pub fn write(bal: &Bal) -> String {
    let mut text = format!("{} {} {}\n", bal.cameras.len(), bal.points.len(), bal.observations.len());
    // Writing to a string does not fail.
    for o in &bal.observations {
        let _ = writeln!(text, "{} {} {} {}", o.camera, o.point, o.pixel.x, o.pixel.y);
    }
    for c in &bal.cameras {
        let (w, t) = (c.camera_from_world.rotation.log(), &c.camera_from_world.translation);
        for v in [w.x, w.y, w.z, t.x, t.y, t.z, c.focal, c.k1, c.k2] {
            let _ = writeln!(text, "{v}");
        }
    }
    for v in bal.points.iter().flat_map(|p| p.iter()) {
        let _ = writeln!(text, "{v}");
    }
    text
}
