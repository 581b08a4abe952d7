//! FAST scores of a row and of the neighbourhood of a corner. See [`super::fast`].

use super::{Backend, fast_scalar};
use cairn_sensor::GrayImage;

/// Scores of a row from column `x0`, [`CELL`](fast_scalar::CELL) columns per threshold. All columns must be at least three from every
/// edge, except that the last cell may extend beyond the row. `out` is indexed by column.
pub(super) fn score_row(
    image: &GrayImage,
    y: usize,
    x0: usize,
    thresholds: &[u8],
    out: &mut [u8],
    backend: Backend,
) {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::fast_avx512::score_row(image, y, x0, thresholds, out),
        Backend::Avx2 => return super::fast_avx2::score_row(image, y, x0, thresholds, out),
        Backend::Scalar => {}
    }
    let _ = backend;
    fast_scalar::score_row(image, y, x0, thresholds, out);
}

/// Scores, without threshold, of the 5 x 5 pixels around a pixel at least [`super::BORDER`] from the edge, row by row.
pub(super) fn scores_around(image: &GrayImage, x: usize, y: usize, backend: Backend) -> [[u8; 5]; 5] {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx512 {
        return super::fast_avx512::scores_around(image, x, y);
    }
    let mut out = [[0; 5]; 5];
    for (v, out) in out.iter_mut().enumerate() {
        let y = y + v - 2;
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx2 {
            *out = super::fast_avx2::five_scores(image, x - 2, y);
            continue;
        }
        let _ = backend;
        *out = fast_scalar::five_scores(image, x - 2, y);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::fast_scalar::CIRCLE;
    use super::*;

    /// Directly from the definition: the greatest threshold, plus one, at which nine contiguous pixels pass.
    fn by_definition(image: &GrayImage, x: usize, y: usize) -> u8 {
        let centre = image.at(x, y) as i32;
        let ring = CIRCLE
            .map(|[dx, dy]| image.at(x.wrapping_add_signed(dx), y.wrapping_add_signed(dy)) as i32 - centre);
        let is_corner = |t: i32| {
            (0..16).any(|k| (0..9).all(|i| ring[(k + i) & 15] > t) || (0..9).all(|i| ring[(k + i) & 15] < -t))
        };
        (0..255).take_while(|&t| is_corner(t)).count() as u8
    }

    #[test]
    fn scores_match_the_definition() {
        let (w, h) = (70, 40);
        let mut random = cairn_random::Random::new(3);
        // Noise on blocks, so that many pixels are corners.
        let mut next = |i: usize| ((i % w / 5 + i / w / 5) % 2 * 150 + random.below(90)) as u8;
        let image = GrayImage::from_vec(w, h, (0..w * h).map(&mut next).collect()).unwrap();
        let (mut corners, mut row) = (0, vec![0; w + 64]);
        for backend in Backend::every() {
            for y in 16..24 {
                score_row(&image, y, 16, &[0, 0], &mut row, backend);
                for x in 16..w - 16 {
                    let expected = by_definition(&image, x, y);
                    assert_eq!(row[x], expected, "{x} {y}");
                    assert_eq!(scores_around(&image, x, y, backend)[2][2], expected);
                    corners += (expected > 0) as usize;
                }
            }
        }
        assert!(corners > 60, "{corners}");
    }
}
