//! The two numbers of a lens, and what they do to a pixel.

use cairn_geometry::Vec2;
use cairn_sensor::{Camera, Distortion};
use nalgebra::Matrix2;

/// A lens relative to a guess without distortion: with the pixel's offset `d` from the principal point and
/// `rho = |d| / (focal * guessed focal length)`, the ray of the pixel is that of an ideal pinhole at
/// `d * (1 + radial * rho^2)` (Brown's radial polynomial from the distorted to the ideal point, first term).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// The focal length as a multiple of the guessed one.
    pub focal: f64,
    /// Radial distortion; about minus the `k1` of models that distort the ideal point.
    pub radial: f64,
}

impl Lens {
    /// The lens as guessed.
    pub const GUESS: Self = Self { focal: 1.0, radial: 0.0 };

    /// The camera with this lens, for a guess without distortion.
    pub fn camera(&self, guess: &Camera) -> Camera {
        Camera {
            fx: self.focal * guess.fx,
            fy: self.focal * guess.fy,
            distortion: Distortion::InverseRadialTangential([self.radial, 0.0, 0.0, 0.0, 0.0]),
            ..*guess
        }
    }

    /// An offset from the principal point without the distortion, in pixels of the true focal length.
    pub(crate) fn stretched(&self, camera: &cairn_solve::Pinhole, d: &Vec2) -> Vec2 {
        d * (1.0 + self.radial * self.rho_squared(camera, d))
    }

    /// The derivative of [`Lens::stretched`] by the offset.
    pub(crate) fn by_offset(&self, camera: &cairn_solve::Pinhole, d: &Vec2) -> Matrix2<f64> {
        let f = Vec2::new(camera.fx * self.focal, camera.fy * self.focal);
        let by_rho = Vec2::new(d.x / f.x.powi(2), d.y / f.y.powi(2)) * (2.0 * self.radial);
        Matrix2::identity() * (1.0 + self.radial * self.rho_squared(camera, d)) + d * by_rho.transpose()
    }

    /// The square of the offset over the focal length.
    pub(crate) fn rho_squared(&self, camera: &cairn_solve::Pinhole, d: &Vec2) -> f64 {
        (d.x / camera.fx).powi(2) / self.focal.powi(2) + (d.y / camera.fy).powi(2) / self.focal.powi(2)
    }
}
