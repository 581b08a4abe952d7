//! Writes any source as a folder in a well-known layout, completely or not at all.

mod euroc;
mod folder;
mod tum;

pub use euroc::write_euroc;
pub use tum::write_tum;

use cairn_sensor::{Camera, Distortion, SourceError};

/// The four radial-tangential coefficients of a camera; these layouts support no other lenses.
fn radial_tangential(name: &str, camera: &Camera) -> Result<[f64; 4], SourceError> {
    match camera.distortion {
        Distortion::None => Ok([0.0; 4]),
        Distortion::RadialTangential([k1, k2, p1, p2, 0.0]) => Ok([k1, k2, p1, p2]),
        _ => Err(SourceError::new(
            name,
            "the layout supports four radial-tangential coefficients and no other lens",
            "undistort the images first",
        )),
    }
}
