//! Portable version of [`super::orientation`], and the disc that every version sums over.

use cairn_sensor::GrayImage;

/// Radius of the disc in pixels.
pub(super) const RADIUS: usize = 15;

/// Half width of the disc in the row `dy` from its centre: the largest `x` with `x^2 + dy^2 <= RADIUS^2`, for `dy` 0 to
/// 15.
pub(super) const HALF_WIDTH: [usize; RADIUS + 1] =
    [15, 14, 14, 14, 14, 14, 13, 13, 12, 12, 11, 10, 9, 7, 5, 0];

/// See [`super::orientation::moments`].
pub(super) fn moments(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    let (mut m10, mut m01) = (0i32, 0i32);
    for dy in -(RADIUS as isize)..=RADIUS as isize {
        let half = HALF_WIDTH[dy.unsigned_abs()];
        let row = &image.row(y.wrapping_add_signed(dy))[x - half..=x + half];
        let mut sum = 0;
        for (i, &v) in row.iter().enumerate() {
            sum += v as i32;
            m10 += (i as i32 - half as i32) * v as i32;
        }
        m01 += dy as i32 * sum;
    }
    [m10, m01]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_widths_match_the_disc() {
        for (dy, &half) in HALF_WIDTH.iter().enumerate() {
            assert!(half * half + dy * dy <= RADIUS * RADIUS);
            assert!((half + 1) * (half + 1) + dy * dy > RADIUS * RADIUS);
        }
    }
}
