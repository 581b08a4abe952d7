//! Where in its pixel a corner is: the peak of a parabola through the FAST scores of the pixel and its neighbours.

use super::fast::score_at;
use cairn_sensor::GrayImage;

/// Offset of the peak from the pixel's centre, each within half a pixel.
pub(super) fn refine(image: &GrayImage, x: usize, y: usize) -> [f32; 2] {
    let s = |dx: isize, dy: isize| {
        score_at(image, x.wrapping_add_signed(dx), y.wrapping_add_signed(dy), 0) as f32
    };
    let centre = s(0, 0);
    [peak(s(-1, 0), centre, s(1, 0)), peak(s(0, -1), centre, s(0, 1))]
}

fn peak(before: f32, here: f32, after: f32) -> f32 {
    let bend = before - 2.0 * here + after;
    if bend >= 0.0 { 0.0 } else { (0.5 * (before - after) / bend).clamp(-0.5, 0.5) }
}
