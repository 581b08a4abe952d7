//! Camera models: projection of points in the camera frame to pixels, and the inverse.

use crate::Distortion;
use crate::error::RigError;
use cairn_geometry::{Vec2, Vec3};

/// Maximum width and height in pixels: lookup tables grow with them.
const MAX_SIDE: usize = 16_384;

/// A calibrated camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Focal length along x in pixels.
    pub fx: f64,
    /// Focal length along y in pixels.
    pub fy: f64,
    /// Principal point, x, in pixels; pixel centres are at integer coordinates.
    pub cx: f64,
    /// Principal point, y, in pixels.
    pub cy: f64,
    /// Lens distortion.
    pub distortion: Distortion,
}

impl Camera {
    /// A pinhole camera without distortion.
    pub fn pinhole(width: usize, height: usize, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { width, height, fx, fy, cx, cy, distortion: Distortion::None }
    }

    /// A guess for an unknown camera: focal length 0.7 of the longer side (71 degrees wide, as most phones film), no distortion.
    pub fn guessed(width: usize, height: usize) -> Self {
        let f = 0.7 * width.max(height) as f64;
        Self::pinhole(width, height, f, f, 0.5 * (width as f64 - 1.0), 0.5 * (height as f64 - 1.0))
    }

    /// Projects a point in the camera frame to a pixel; `None` where the model has no image of it (behind the camera,
    /// at its centre, or beyond the angle where the model folds over). The pixel may lie outside the image.
    pub fn project(&self, p: &Vec3) -> Option<Vec2> {
        let [x, y] = self.distortion.distort(p)?;
        let px = Vec2::new(self.fx * x + self.cx, self.fy * y + self.cy);
        (px.x.is_finite() && px.y.is_finite()).then_some(px)
    }

    /// The unit bearing of a pixel in the camera frame; `None` where no ray projects to that pixel.
    pub fn unproject(&self, px: &Vec2) -> Option<Vec3> {
        let ray = self.distortion.undistort([(px.x - self.cx) / self.fx, (px.y - self.cy) / self.fy])?;
        ray.iter().all(|v| v.is_finite()).then(|| ray.normalize())
    }

    /// True when the pixel lies inside the image.
    pub fn contains(&self, px: &Vec2) -> bool {
        px.x >= 0.0 && px.y >= 0.0 && px.x <= (self.width - 1) as f64 && px.y <= (self.height - 1) as f64
    }

    /// Checks that the numbers are plausible for a camera.
    ///
    /// # Errors
    /// When a number is not finite, the resolution is zero or too large, a focal length is not positive, the principal
    /// point is far outside the image, or the distortion is invalid.
    pub fn validate(&self) -> Result<(), RigError> {
        let numbers = [("fx", self.fx), ("fy", self.fy), ("cx", self.cx), ("cy", self.cy)];
        if let Some((name, v)) = numbers.iter().find(|(_, v)| !v.is_finite()) {
            return Err(RigError(format!("{name} is {v}")));
        }
        if self.width == 0 || self.height == 0 {
            return Err(RigError(format!("resolution {}x{}", self.width, self.height)));
        }
        if self.width.max(self.height) > MAX_SIDE {
            let why = format!("resolution {}x{}, at most {MAX_SIDE} each way", self.width, self.height);
            return Err(RigError(why));
        }
        if self.fx <= 0.0 || self.fy <= 0.0 {
            return Err(RigError(format!("focal lengths {} and {} must be positive", self.fx, self.fy)));
        }
        let (w, h) = (self.width as f64, self.height as f64);
        if self.cx < -0.5 * w || self.cx > 1.5 * w || self.cy < -0.5 * h || self.cy > 1.5 * h {
            return Err(RigError(format!(
                "principal point ({}, {}) is far outside {w}x{h}",
                self.cx, self.cy
            )));
        }
        self.distortion.validate()
    }
}
