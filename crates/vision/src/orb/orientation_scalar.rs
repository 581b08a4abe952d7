//! Portable version of [`super::orientation`], and the disc that every version sums over.

use cairn_sensor::GrayImage;

/// Radius of the disc in pixels.
pub(super) const RADIUS: usize = 15;

/// Half width of the disc in the row `dy` from its centre: the largest `x` with `x^2 + dy^2 <= RADIUS^2`, for `dy` 0 to
/// 15.
pub(super) const HALF_WIDTH: [usize; RADIUS + 1] =
    [15, 14, 14, 14, 14, 14, 13, 13, 12, 12, 11, 10, 9, 7, 5, 0];

/// For each distance from the middle row: all ones for pixels in the disc, of the 32 starting 16 left of the centre.
pub(super) static MASK: [[u8; 32]; RADIUS + 1] = {
    let mut out = [[0; 32]; RADIUS + 1];
    let mut dy = 0;
    while dy <= RADIUS {
        let mut i = 16 - HALF_WIDTH[dy];
        while i <= 16 + HALF_WIDTH[dy] {
            out[dy][i] = 255;
            i += 1;
        }
        dy += 1;
    }
    out
};

/// See [`super::orientation::moments`].
pub(super) fn moments(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    // Sums of the columns of the disc, plain and weighted by the row: both fit sixteen bits.
    let (mut plain, mut weighted) = ([0i16; 32], [0i16; 32]);
    for dy in -(RADIUS as isize)..=RADIUS as isize {
        let row = &image.row(y.wrapping_add_signed(dy))[x - 16..x + 16];
        let mask = &MASK[dy.unsigned_abs()];
        for i in 0..32 {
            let v = (row[i] & mask[i]) as i16;
            plain[i] += v;
            weighted[i] += dy as i16 * v;
        }
    }
    let across = (0..32).map(|i| (i as i32 - 16) * plain[i] as i32).sum();
    [across, weighted.iter().map(|&sum| sum as i32).sum()]
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
