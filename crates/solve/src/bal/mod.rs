//! Bundle adjustment in the large: the problems and the camera of the BAL data set, as text and solved.
//!
//! Source: Agarwal, Snavely, Seitz, Szeliski, "Bundle adjustment in the large" (2010), and the page of its data set:
//! cameras look along -z, and a point `p` of the world projects to `f (1 + k1 n^2 + k2 n^4) n` with
//! `n = -(x, y) / z` of `R p + t`, in pixels from the image's centre.

mod bundler;
mod camera;
mod solve;
mod text;
mod words;

pub use camera::BalCamera;
pub use solve::BalConfig;
pub use text::{read, write};

use cairn_geometry::{Vec2, Vec3};

/// One point observed by one camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BalObservation {
    /// Index of the camera.
    pub camera: u32,
    /// Index of the point.
    pub point: u32,
    /// Pixels from the image's centre, x to the right and y up.
    pub pixel: Vec2,
}

/// Cameras, points and observations.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Bal {
    /// Cameras, each with a lens of its own.
    pub cameras: Vec<BalCamera>,
    /// Points in the world.
    pub points: Vec<Vec3>,
    /// Observations; their indices are within the lists above.
    pub observations: Vec<BalObservation>,
}
