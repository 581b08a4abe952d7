//! FAST-9 corners: Rosten and Drummond, "Machine learning for high-speed corner detection", ECCV 2006.
//!
//! A pixel's score is the largest `s` for which nine neighbours in a row, of the sixteen on the circle of
//! radius three, are all at least `s` brighter, or all at least `s` darker; it is a corner for a threshold below `s`.
//! Scores are computed densely (zero at or below the threshold), and a corner is kept where its
//! score is the greatest of its 3 x 3 neighbours, the first of equals in reading order.

use super::{BORDER, Backend};
use cairn_sensor::GrayImage;

/// A corner of one level.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) x: u16,
    pub(super) y: u16,
    /// FAST score.
    pub(super) score: u8,
}

/// The circle of radius three, clockwise from the top.
pub(super) const CIRCLE: [[isize; 2]; 16] = [
    [0, -3],
    [1, -3],
    [2, -2],
    [3, -1],
    [3, 0],
    [3, 1],
    [2, 2],
    [1, 3],
    [0, 3],
    [-1, 3],
    [-2, 2],
    [-3, 1],
    [-3, 0],
    [-3, -1],
    [-2, -2],
    [-1, -3],
];

/// Three rows of scores, as far as suppression looks.
#[derive(Clone, Debug, Default)]
pub(super) struct Scores {
    rows: [Vec<u8>; 3],
}

/// Finds corners at least [`BORDER`] from the edge with a score above `threshold`, in reading order.
pub(super) fn corners(
    image: &GrayImage,
    threshold: u8,
    scores: &mut Scores,
    out: &mut Vec<Corner>,
    backend: Backend,
) {
    out.clear();
    let (w, h) = (image.width(), image.height());
    if w <= 2 * BORDER || h <= 2 * BORDER || w > i16::MAX as usize || h > i16::MAX as usize {
        return;
    }
    // One pixel more on each side, so that suppression at the rim sees its neighbours.
    let (x0, x1) = (BORDER - 1, w - BORDER + 1);
    for row in &mut scores.rows {
        row.clear();
        row.resize(w + 64, 0);
    }
    for y in BORDER - 1..h - BORDER + 1 {
        score_row(image, y, x0, x1, threshold, &mut scores.rows[y % 3], backend);
        if y > BORDER {
            let [a, b, c] = &scores.rows;
            let rows = match y % 3 {
                0 => [b, c, a],
                1 => [c, a, b],
                _ => [a, b, c],
            };
            peaks(rows.map(|r| r.as_slice()), y - 1, x0 + 1, x1 - 1, out, backend);
        }
    }
}

fn score_row(
    image: &GrayImage,
    y: usize,
    x0: usize,
    x1: usize,
    threshold: u8,
    out: &mut [u8],
    backend: Backend,
) {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx2 {
        return super::fast_avx2::score_row(image, y, x0, x1, threshold, out);
    }
    let _ = backend;
    for (x, out) in out.iter_mut().enumerate().take(x1).skip(x0) {
        *out = score_at(image, x, y, threshold);
    }
}

/// Scores of the 5 x 5 pixels around a place at least [`BORDER`] from the edge, row by row, with no threshold.
pub(super) fn scores_around(image: &GrayImage, x: usize, y: usize, backend: Backend) -> [[u8; 5]; 5] {
    let mut out = [[0; 5]; 5];
    for (v, out) in out.iter_mut().enumerate() {
        let y = y + v - 2;
        #[cfg(target_arch = "x86_64")]
        if backend == Backend::Avx2 {
            *out = super::fast_avx2::five_scores(image, x - 2, y);
            continue;
        }
        let _ = backend;
        *out = std::array::from_fn(|u| score_at(image, x + u - 2, y, 0));
    }
    out
}

/// Score of the pixel at a place at least three from the edge, or 0 at or below the threshold.
fn score_at(image: &GrayImage, x: usize, y: usize, threshold: u8) -> u8 {
    let (w, data) = (image.width() as isize, image.data());
    let at = y * image.width() + x;
    let ring = CIRCLE.map(|[dx, dy]| data[at.wrapping_add_signed(dy * w + dx)]);
    score(data[at], &ring, threshold)
}

/// Score of one pixel, or 0 at or below the threshold.
fn score(centre: u8, p: &[u8; 16], threshold: u8) -> u8 {
    // Nine in a row hold two neighbouring compass points, so these bound the score.
    let bright = p[0].max(p[8]).min(p[4].max(p[12])).saturating_sub(centre);
    let dark = centre.saturating_sub(p[0].min(p[8]).max(p[4].min(p[12])));
    if bright.max(dark) <= threshold {
        return 0;
    }
    let (mut brightest, mut darkest) = (0u8, 255u8);
    // Each turn covers the two arcs that share p[k + 1] to p[k + 8].
    for k in (0..16).step_by(2) {
        let (mut low, mut high) = (255u8, 0u8);
        for i in 1..=8 {
            low = low.min(p[(k + i) & 15]);
            high = high.max(p[(k + i) & 15]);
        }
        let ends = [p[k], p[(k + 9) & 15]];
        brightest = brightest.max(low.min(ends[0].max(ends[1])));
        darkest = darkest.min(high.max(ends[0].min(ends[1])));
    }
    let s = brightest.saturating_sub(centre).max(centre.saturating_sub(darkest));
    if s > threshold { s } else { 0 }
}

/// Keeps the peaks of the middle of three rows of scores.
fn peaks(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>, backend: Backend) {
    #[cfg(target_arch = "x86_64")]
    if backend == Backend::Avx2 {
        return super::fast_avx2::peaks(rows, y, x0, x1, out);
    }
    let _ = backend;
    let [above, here, below] = rows;
    for x in x0..x1 {
        let s = here[x];
        let before = above[x - 1].max(above[x]).max(above[x + 1]).max(here[x - 1]);
        let after = below[x - 1].max(below[x]).max(below[x + 1]).max(here[x + 1]);
        if s > before && s >= after {
            out.push(Corner { x: x as u16, y: y as u16, score: s });
        }
    }
}
