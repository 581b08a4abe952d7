//! One depth image prepared for fusion: metres along the optical axis of an ideal pinhole, with a weight for each
//! pixel ([`crate::pixel`]).

use crate::pixel::{depth_of, weight_of};
use crate::pyramid::DepthPyramid;
use cairn_sensor::Camera;

/// A prepared depth image; [`crate::DepthPreparer`] makes them.
#[derive(Clone, Debug)]
pub struct DepthFrame {
    pub(crate) camera: Camera,
    pub(crate) pixels: Vec<u32>,
    pub(crate) pyramid: DepthPyramid,
    pub(crate) valid: usize,
}

impl DepthFrame {
    /// The ideal pinhole camera of these pixels.
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.camera.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.camera.height
    }

    /// Depth in metres along the optical axis; `None` where there is none, and outside the image.
    pub fn depth_m(&self, x: usize, y: usize) -> Option<f32> {
        if x >= self.width() || y >= self.height() {
            return None;
        }
        let p = self.pixels[y * self.width() + x];
        (weight_of(p) > 0).then(|| depth_of(p))
    }

    /// Number of pixels with a depth.
    pub fn valid(&self) -> usize {
        self.valid
    }

    /// Least and greatest depth in metres; `None` when no pixel has one.
    pub fn range_m(&self) -> Option<(f32, f32)> {
        self.pyramid.range_m()
    }
}
