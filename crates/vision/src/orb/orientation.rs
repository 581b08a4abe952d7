//! Orientation of a patch by its intensity centroid: Rosin 1999; Rublee et al. 2011, equations 1 to 3.

use super::Backend;
use cairn_sensor::GrayImage;

/// Radius of the disc in pixels.
pub(super) const RADIUS: usize = 15;

/// Half width of the disc in the row `dy` from its centre: the largest `x` with `x^2 + dy^2 <= RADIUS^2`, for `dy` 0 to
/// 15.
pub(super) const HALF_WIDTH: [usize; RADIUS + 1] =
    [15, 14, 14, 14, 14, 14, 13, 13, 12, 12, 11, 10, 9, 7, 5, 0];

/// First moments `[m10, m01]` of the disc around a pixel at least [`RADIUS`] from the edge (at least 16 for AVX2).
pub(super) fn moments(image: &GrayImage, x: usize, y: usize, backend: Backend) -> [i32; 2] {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::orientation_avx512::moments(image, x, y),
        Backend::Avx2 => return super::orientation_avx2::moments(image, x, y),
        Backend::Scalar => {}
    }
    let _ = backend;
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

/// Cosine and sine of a direction in units of 1/16384; uses only correctly rounded operations, so the result is the
/// same on every machine.
pub(super) fn direction([m10, m01]: [i32; 2]) -> [i16; 2] {
    if m10 == 0 && m01 == 0 {
        return [16384, 0];
    }
    let (x, y) = (m10 as f64, m01 as f64);
    let scale = 16384.0 / (x * x + y * y).sqrt();
    [(x * scale).round() as i16, (y * scale).round() as i16]
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

    #[test]
    fn ramp_orientation_is_its_gradient() {
        let (w, h) = (64, 64);
        for (ax, ay) in [(1.0f64, 0.0), (0.0, 1.0), (-1.0, 0.5), (0.3, -1.0)] {
            let data = (0..w * h)
                .map(|i| (128.0 + ax * ((i % w) as f64 - 32.0) + ay * ((i / w) as f64 - 32.0)).round() as u8)
                .collect();
            let image = GrayImage::from_vec(w, h, data).unwrap();
            let [c, s] = direction(moments(&image, 32, 32, Backend::Scalar));
            let angle = (s as f64).atan2(c as f64);
            assert!((angle - ay.atan2(ax)).abs() < 0.02, "{angle} {ax} {ay}");
        }
    }
}
