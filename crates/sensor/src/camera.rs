//! Camera models: how a point in the camera frame becomes a pixel, and back.

use crate::RigError;
use cairn_geometry::{Vec2, Vec3};

/// Lens distortion, with the coefficients of the model's usual order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// A perfect pinhole.
    None,
    /// Brown-Conrady: `[k1, k2, p1, p2, k3]`.
    RadialTangential([f64; 5]),
}

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
    /// Principal point, x, in pixels; pixel centres are at whole numbers.
    pub cx: f64,
    /// Principal point, y, in pixels.
    pub cy: f64,
    /// The lens.
    pub distortion: Distortion,
}

impl Camera {
    /// A pinhole without distortion.
    pub fn pinhole(width: usize, height: usize, fx: f64, fy: f64, cx: f64, cy: f64) -> Self {
        Self { width, height, fx, fy, cx, cy, distortion: Distortion::None }
    }

    /// The pixel of a point in the camera frame; `None` where the model has no image of it (behind, at the
    /// centre, or past the angle where the model folds back). The pixel may lie outside the image.
    pub fn project(&self, p: &Vec3) -> Option<Vec2> {
        if p.z <= 1e-9 {
            return None;
        }
        let (x, y) = (p.x / p.z, p.y / p.z);
        let (x, y) = match &self.distortion {
            Distortion::None => (x, y),
            Distortion::RadialTangential(c) => radial_tangential(c, x, y)?,
        };
        Some(Vec2::new(self.fx * x + self.cx, self.fy * y + self.cy))
    }

    /// The unit bearing of a pixel in the camera frame; `None` where the model can not be inverted there.
    pub fn unproject(&self, px: &Vec2) -> Option<Vec3> {
        let (xd, yd) = ((px.x - self.cx) / self.fx, (px.y - self.cy) / self.fy);
        let (x, y) = match &self.distortion {
            Distortion::None => (xd, yd),
            Distortion::RadialTangential(c) => {
                // Newton-like fixed point, then a check: a point past the fold does not come back.
                let (mut x, mut y) = (xd, yd);
                for _ in 0..30 {
                    let (fx, fy) = radial_tangential(c, x, y)?;
                    let (ex, ey) = (xd - fx, yd - fy);
                    x += ex;
                    y += ey;
                    if ex * ex + ey * ey < 1e-24 {
                        break;
                    }
                }
                let (fx, fy) = radial_tangential(c, x, y)?;
                if (fx - xd).hypot(fy - yd) > 1e-6 {
                    return None;
                }
                (x, y)
            }
        };
        Some(Vec3::new(x, y, 1.0).normalize())
    }

    /// True when the pixel lies inside the image.
    pub fn contains(&self, px: &Vec2) -> bool {
        px.x >= 0.0 && px.y >= 0.0 && px.x <= (self.width - 1) as f64 && px.y <= (self.height - 1) as f64
    }

    /// Refuses numbers that can not be a camera.
    pub fn validate(&self) -> Result<(), RigError> {
        let numbers = [("fx", self.fx), ("fy", self.fy), ("cx", self.cx), ("cy", self.cy)];
        if let Some((name, v)) = numbers.iter().find(|(_, v)| !v.is_finite()) {
            return Err(RigError(format!("{name} is {v}")));
        }
        if self.width == 0 || self.height == 0 {
            return Err(RigError(format!("resolution {}x{}", self.width, self.height)));
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
        let coefficients: &[f64] = match &self.distortion {
            Distortion::None => &[],
            Distortion::RadialTangential(c) => c,
        };
        if let Some(v) = coefficients.iter().find(|v| !v.is_finite()) {
            return Err(RigError(format!("a distortion coefficient is {v}")));
        }
        Ok(())
    }
}

fn radial_tangential(c: &[f64; 5], x: f64, y: f64) -> Option<(f64, f64)> {
    let [k1, k2, p1, p2, k3] = *c;
    let r2 = x * x + y * y;
    // Past the radius where the radial polynomial turns, two rays share a pixel: no image there.
    let slope = 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3));
    if slope <= 0.0 {
        return None;
    }
    let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    Some((
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    ))
}
