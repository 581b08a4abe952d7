//! The local affine warp of a patch from the left image to the right one, and its motion with disparity.

use crate::rectify::Rectifier;
use cairn_geometry::Vec2;
use nalgebra::Matrix2;

use super::patch::RADIUS;

/// The local affine map from a left level to the right one.
pub(super) struct Warp {
    /// Right level position at the initial disparity.
    origin: [f64; 2],
    /// Motion of the right position per pixel (of the level) of disparity.
    direction: [f64; 2],
    /// The same motion, mapped back into the left level.
    pub direction_left: [f32; 2],
    /// Matrix from left offsets to right offsets, row by row.
    pub affine: [f32; 4],
}

impl Warp {
    /// Linearised around an integer position on a left level whose pixels are `scale` image pixels wide, at a disparity
    /// in rectified pixels; `None` where either lens cannot project the patch.
    pub(super) fn new(
        left: &Rectifier,
        right: &Rectifier,
        centre: [f64; 2],
        scale: f64,
        disparity: f64,
    ) -> Option<Self> {
        let to_raw = |c: f64| (c + 0.5) * scale - 0.5;
        let to_level = |c: f64| (c + 0.5) / scale - 0.5;
        let raw = centre.map(to_raw);
        if left.is_identity() && right.is_identity() {
            return Some(Self {
                origin: [to_level(raw[0] - disparity), centre[1]],
                direction: [-1.0, 0.0],
                direction_left: [-1.0, 0.0],
                affine: [1.0, 0.0, 0.0, 1.0],
            });
        }
        let rectify = |dx: f64, dy: f64| {
            let p = left.rectify([(raw[0] + dx) as f32, (raw[1] + dy) as f32])?;
            Some(Vec2::new(p[0] as f64, p[1] as f64))
        };
        // Central differences over the extent of the patch.
        let h = RADIUS as f64 * scale;
        let middle = rectify(0.0, 0.0)?;
        let rectified_from_left = Matrix2::from_columns(&[
            (rectify(h, 0.0)? - rectify(-h, 0.0)?) / (2.0 * h),
            (rectify(0.0, h)? - rectify(0.0, -h)?) / (2.0 * h),
        ]);
        let there = middle - Vec2::new(disparity, 0.0);
        let project = |dx: f64, dy: f64| right.raw([there.x + dx, there.y + dy]);
        let origin = project(0.0, 0.0)?;
        let right_from_rectified = Matrix2::from_columns(&[
            (project(h, 0.0)? - project(-h, 0.0)?) / (2.0 * h),
            (project(0.0, h)? - project(0.0, -h)?) / (2.0 * h),
        ]);
        let right_from_left = right_from_rectified * rectified_from_left;
        let direction = -right_from_rectified.column(0);
        let direction_left = right_from_left.try_inverse()? * direction;
        let m = right_from_left.map(|v| v as f32);
        Some(Self {
            origin: [to_level(origin.x), to_level(origin.y)],
            direction: [direction.x, direction.y],
            direction_left: [direction_left.x as f32, direction_left.y as f32],
            affine: [m.m11, m.m12, m.m21, m.m22],
        })
    }

    /// Right level position after a shift of the disparity in pixels of the level.
    pub(super) fn at(&self, shift: f64) -> [f64; 2] {
        [self.origin[0] + shift * self.direction[0], self.origin[1] + shift * self.direction[1]]
    }
}
