//! FAST-9 corners: Rosten and Drummond, "Machine learning for high-speed corner detection", ECCV 2006.
//!
//! A pixel's score is the largest `s` for which nine neighbours in a row, of the sixteen on the circle of
//! radius three, are all at least `s` brighter, or all at least `s` darker; it is a corner for a threshold below `s`.
//! Scores are computed densely (zero at or below the threshold), and a corner is kept where its
//! score is the greatest of its 3 x 3 neighbours, the first of equals in reading order.

use super::fast_score::score_row;
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
        if s == 0 {
            continue;
        }
        let before = above[x - 1].max(above[x]).max(above[x + 1]).max(here[x - 1]);
        let after = below[x - 1].max(below[x]).max(below[x + 1]).max(here[x + 1]);
        if s > before && s >= after {
            out.push(Corner { x: x as u16, y: y as u16, score: s });
        }
    }
}
