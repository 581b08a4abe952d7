//! The image of a map's rectified camera, a pinhole without distortion.
//!
//! It begins at the first whole pixel of the camera's bounds, and the centre of that pixel is at 0.5, 0.5, as COLMAP and
//! nerfstudio's cameras have it.

use cairn_geometry::{Vec2, Vec3};
use cairn_vision::RectifiedCamera;

/// Rounding that is no pixel more: bounds are kept from single precision.
const ROUNDING_PX: f64 = 0.01;

/// The image of a rectified camera: a part of its plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pinhole {
    pub width: usize,
    pub height: usize,
    /// Focal lengths in pixels.
    pub focal: Vec2,
    /// The principal point from the corner of the first pixel.
    pub centre: Vec2,
    /// The corner of the first pixel in rectified pixels.
    pub corner: Vec2,
}

impl Pinhole {
    /// The whole view of a camera.
    pub fn of(camera: &RectifiedCamera) -> Self {
        let [x0, y0, x1, y1] = camera.bounds;
        let first = |bound: f64| (bound + 0.5 + ROUNDING_PX).floor();
        let side =
            |from: f64, to: f64| ((to - 0.5 - ROUNDING_PX).ceil() - first(from) + 1.0).max(1.0) as usize;
        let corner = Vec2::new(first(x0) - 0.5, first(y0) - 0.5);
        Self {
            width: side(x0, x1),
            height: side(y0, y1),
            focal: Vec2::new(camera.fx, camera.fy),
            centre: Vec2::new(camera.cx, camera.cy) - corner,
            corner,
        }
    }

    /// The pixel of a point in the frame of the camera; `None` behind it.
    pub fn project(&self, p: &Vec3) -> Option<Vec2> {
        (p.z > 0.0).then(|| (p.xy() / p.z).component_mul(&self.focal) + self.centre)
    }
}
