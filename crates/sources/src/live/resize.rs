//! A picture in another size: a phone on a slow link sends smaller ones, and the rig stays the same.

use cairn_sensor::GrayImage;

/// How far the aspect ratios of two sizes of the same picture may differ: sides are whole pixels.
const SAME_ASPECT: f64 = 0.01;

/// Whether two sizes can be of the same picture.
pub(super) fn same_aspect([w, h]: [usize; 2], [to_w, to_h]: [usize; 2]) -> bool {
    let (a, b) = ((w * to_h) as f64, (h * to_w) as f64);
    w >= 16 && h >= 16 && (a - b).abs() <= SAME_ASPECT * a.max(b)
}

/// The picture resampled bilinearly; the outer edges of both coincide, so that pixel `x` lies at
/// `(x + 1/2) w / to_w - 1/2` of the original.
pub(super) fn resized(image: &GrayImage, [to_w, to_h]: [usize; 2]) -> GrayImage {
    let (w, h) = (image.width(), image.height());
    let mut out = GrayImage::new(to_w, to_h);
    let columns: Vec<_> = (0..to_w).map(|x| between(x, w, to_w)).collect();
    for y in 0..to_h {
        let (above, below, v) = between(y, h, to_h);
        let (top, bottom) = (image.row(above), image.row(below));
        for (to, &(left, right, u)) in out.row_mut(y).iter_mut().zip(&columns) {
            let mix = |row: &[u8]| (256 - u) * u32::from(row[left]) + u * u32::from(row[right]);
            *to = (((256 - v) * mix(top) + v * mix(bottom) + (1 << 15)) >> 16) as u8;
        }
    }
    out
}

/// The two original pixels around a new one, and the weight of the second in 256ths.
fn between(x: usize, from: usize, to: usize) -> (usize, usize, u32) {
    let at = ((x as f64 + 0.5) * from as f64 / to as f64 - 0.5).clamp(0.0, (from - 1) as f64);
    let first = at as usize;
    (first, (first + 1).min(from - 1), ((at - first as f64) * 256.0) as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_keeps_its_place_and_the_same_size_its_pixels() {
        let (w, h) = (64, 48);
        let mut image = GrayImage::new(w, h);
        for y in 0..h {
            for x in 0..w {
                image.row_mut(y)[x] = (2 * x + y) as u8;
            }
        }
        assert_eq!(resized(&image, [w, h]).data(), image.data());
        let large = resized(&image, [128, 96]);
        for (x, y) in [(40, 30), (81, 53)] {
            let expected = 2.0 * (0.5 * (x as f64 + 0.5) - 0.5) + 0.5 * (y as f64 + 0.5) - 0.5;
            assert!((f64::from(large.row(y)[x]) - expected).abs() <= 1.0, "{} {expected}", large.row(y)[x]);
        }
        assert!(same_aspect([640, 480], [321, 240]) && !same_aspect([640, 480], [480, 640]));
        assert!(same_aspect([854, 480], [320, 180]) && !same_aspect([4, 3], [640, 480]));
    }
}
