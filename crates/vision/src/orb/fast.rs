//! FAST-9 corners: Rosten and Drummond, "Machine learning for high-speed corner detection", ECCV 2006.
//!
//! A pixel's score is the largest `s` for which nine contiguous pixels, of the sixteen on the circle of radius three,
//! are all at least `s` brighter or all at least `s` darker; it is a corner for thresholds below `s`. Scores are
//! computed densely (zero at or below the threshold) and non-maximum suppression keeps a corner where its score is the
//! greatest of its 3 x 3 neighbourhood, the first of equals in reading order.
//!
//! The image is divided into cells of 32 x 32 pixels with two thresholds: a cell with a corner above the high threshold
//! keeps only such corners; another cell keeps all that pass the low one. Once a row of a cell has a strong corner, the
//! rows below are searched with the high threshold only, which saves most of the work.

use super::fast_scalar::CELL;
use super::fast_score::score_row;
use super::{BORDER, Backend};
use cairn_sensor::GrayImage;

pub(super) use super::fast_scalar::Corner;

/// The first column and row with a score: one before the first corner, for non-maximum suppression.
const FIRST: usize = BORDER - 1;

/// Buffers of [`corners`]: the three rows of scores that suppression needs, and the thresholds of a row of cells.
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    rows: [Vec<u8>; 3],
    thresholds: Vec<u8>,
}

/// Finds corners at least [`BORDER`] from the edge, in reading order; thresholds are `[low, high]`.
pub(super) fn corners(
    image: &GrayImage,
    [low, high]: [u8; 2],
    scratch: &mut Scratch,
    out: &mut Vec<Corner>,
    backend: Backend,
) {
    out.clear();
    let (w, h) = (image.width(), image.height());
    if w <= 2 * BORDER || h <= 2 * BORDER || w > i16::MAX as usize || h > i16::MAX as usize {
        return;
    }
    let end = [w, h].map(|n| n - FIRST);
    for row in &mut scratch.rows {
        row.clear();
        row.resize(w + 2 * CELL, 0);
    }
    let thresholds = &mut scratch.thresholds;
    thresholds.clear();
    thresholds.resize((end[0] - FIRST).div_ceil(CELL), low);
    let mut row_start = 0;
    for y in FIRST..end[1] {
        let new_cells = (y - FIRST).is_multiple_of(CELL);
        if new_cells {
            thresholds.fill(low);
        }
        score_row(image, y, FIRST, thresholds, &mut scratch.rows[y % 3], backend);
        if y < FIRST + 2 {
            continue;
        }
        let before = out.len();
        let [a, b, c] = &scratch.rows;
        let rows = match y % 3 {
            0 => [b, c, a],
            1 => [c, a, b],
            _ => [a, b, c],
        };
        peaks(rows.map(|r| r.as_slice()), y - 1, FIRST + 1, end[0] - 1, out, backend);
        if new_cells {
            // The row of cells above is complete.
            keep_strong(out, row_start, high, thresholds);
            thresholds.fill(low);
            row_start = out.len();
        } else {
            raise_thresholds(&out[before..], high, thresholds);
        }
    }
    keep_strong(out, row_start, high, thresholds);
}

/// Sets the high threshold in cells with a strong corner.
fn raise_thresholds(corners: &[Corner], high: u8, thresholds: &mut [u8]) {
    for c in corners.iter().filter(|c| c.score > high) {
        thresholds[(c.x as usize - FIRST) / CELL] = high;
    }
}

/// From the corners starting at `from`, all in one row of cells, drops the weak ones of cells that have a strong one.
fn keep_strong(corners: &mut Vec<Corner>, from: usize, high: u8, thresholds: &mut [u8]) {
    thresholds.fill(0);
    raise_thresholds(&corners[from..], high, thresholds);
    let mut kept = from;
    for i in from..corners.len() {
        let c = corners[i];
        if c.score > thresholds[(c.x as usize - FIRST) / CELL] {
            corners[kept] = c;
            kept += 1;
        }
    }
    corners.truncate(kept);
}

/// Non-maximum suppression: appends the local maxima of the middle of three rows of scores.
fn peaks(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>, backend: Backend) {
    #[cfg(target_arch = "x86_64")]
    match backend {
        Backend::Avx512 => return super::fast_avx512::peaks(rows, y, x0, x1, out),
        Backend::Avx2 => return super::fast_avx2::peaks(rows, y, x0, x1, out),
        Backend::Scalar => {}
    }
    let _ = backend;
    super::fast_scalar::peaks(rows, y, x0, x1, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strong_corner_suppresses_weak_ones_of_its_cell() {
        // Bright squares on black with well separated corners; the weak ones have brightness 12.
        let mut image = GrayImage::new(160, 100);
        for (x0, y0, tone) in
            [(20, 20, 100), (34, 20, 12), (20, 34, 12), (100, 20, 12), (60, 60, 12), (72, 72, 90)]
        {
            for y in y0..y0 + 6 {
                image.row_mut(y)[x0..x0 + 6].fill(tone);
            }
        }
        let mut out = vec![];
        corners(&image, [7, 20], &mut Scratch::default(), &mut out, Backend::detect());
        let has = |x: u16, y: u16| out.iter().any(|c| c.x.abs_diff(x + 3) < 5 && c.y.abs_diff(y + 3) < 5);
        assert!(has(20, 20) && has(72, 72) && has(100, 20), "{out:?}");
        // Weak corners below the strong one, and above it.
        assert!(!has(34, 20) && !has(20, 34) && !has(60, 60), "{out:?}");
    }
}
