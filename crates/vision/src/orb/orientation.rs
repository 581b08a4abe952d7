//! Orientation of a patch by its intensity centroid: Rosin 1999; Rublee et al. 2011, equations 1 to 3.

use super::Backend;
use cairn_sensor::GrayImage;

/// First moments `[m10, m01]` of the disc around a pixel at least 16 from the edge.
pub(super) fn moments(image: &GrayImage, x: usize, y: usize, backend: Backend) -> [i32; 2] {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::orientation_avx512::moments(image, x, y),
        Backend::Avx2 => return super::orientation_avx2::moments(image, x, y),
        Backend::Scalar => {}
    }
    let _ = backend;
    super::orientation_scalar::moments(image, x, y)
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
