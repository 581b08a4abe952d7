//! The sample positions of a warped patch in fixed point.

use super::patch::RADIUS;
use cairn_sensor::GrayImage;

/// Sample positions of a patch: its centre and the steps per column and row, in 1/65536 pixel.
#[derive(Clone, Copy)]
pub(super) struct Lattice {
    pub x: i32,
    pub y: i32,
    /// x per column, x per row, y per column, y per row.
    pub step: [i32; 4],
}

impl Lattice {
    /// `None` when a sample (or the three pixels to its right, which vector code reads) is outside the image.
    pub(super) fn new(image: &GrayImage, centre: [f64; 2], affine: &[f32; 4]) -> Option<Self> {
        // Positions must fit 16.16 fixed point with a margin: levels are at most 16,000 pixels wide, warps at most
        // fourfold.
        let fits = |v: f64| (0.0..16_000.0).contains(&v);
        if !(fits(centre[0]) && fits(centre[1]) && affine.iter().all(|v| v.abs() < 2.0)) {
            return None;
        }
        let fixed = |v: f64| (v * 65536.0) as i32;
        let step = affine.map(|v| fixed(v as f64));
        let (x, y) = (fixed(centre[0]), fixed(centre[1]));
        let reach_x = RADIUS * (step[0].abs() + step[1].abs());
        let reach_y = RADIUS * (step[2].abs() + step[3].abs());
        let inside = x >= reach_x
            && y >= reach_y
            && ((x + reach_x) >> 16) + 4 <= image.width() as i32
            && ((y + reach_y) >> 16) + 2 <= image.height() as i32;
        inside.then_some(Self { x, y, step })
    }
}
