//! AVX2 version of [`super::fast`] and [`super::fast_score`]: 32 pixels at a time, bit-identical.
#![allow(unsafe_code)]

use super::BORDER;
use super::fast_scalar::{CELL, CIRCLE, Corner};
use cairn_sensor::GrayImage;
use std::arch::x86_64::*;

/// See [`super::fast_score::score_row`].
pub(super) fn score_row(image: &GrayImage, y: usize, x0: usize, thresholds: &[u8], out: &mut [u8]) {
    let (w, h) = (image.width(), image.height());
    let end = x0 + thresholds.len() * CELL;
    assert!(w > 2 * BORDER && h > 2 * BORDER, "image smaller than a patch");
    assert!(x0 >= 3 && end <= w + CELL && y >= 3 && y + BORDER <= h && out.len() >= end);
    assert!(is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available. The first block reads from x0 - 3 >= 0 in row y - 3 >= 0 on; the last reads up to
    // column end + 3 <= w + 35 in row y + 3 <= h - 13, that is, before the end of row h - 11. Writes end at `end`.
    unsafe { score_row_avx2(image, y, x0, thresholds, out) }
}

/// # Safety
/// AVX2 must be available, and the bounds that [`score_row`] asserts must hold.
#[target_feature(enable = "avx2")]
unsafe fn score_row_avx2(image: &GrayImage, y: usize, x0: usize, thresholds: &[u8], out: &mut [u8]) {
    let offsets = CIRCLE.map(|[dx, dy]| dy * image.width() as isize + dx);
    for (cell, &threshold) in thresholds.iter().enumerate() {
        let (x, limit) = (x0 + cell * CELL, _mm256_set1_epi8(threshold as i8));
        // SAFETY: see `score_row`.
        unsafe {
            let s = score_block(image.data().as_ptr().add(y * image.width() + x), &offsets, limit);
            _mm256_storeu_si256(out.as_mut_ptr().add(x) as *mut __m256i, s);
        }
    }
}

/// Scores, without threshold, of the five pixels starting at `x` in row `y`.
pub(super) fn five_scores(image: &GrayImage, x: usize, y: usize) -> [u8; 5] {
    let (w, h) = (image.width(), image.height());
    assert!(x >= 3 && x + 34 <= w + BORDER + 2 && y >= 3 && y + BORDER - 2 <= h && w > 2 * BORDER);
    assert!(is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; reads begin at x - 3 >= 0 in row y - 3 >= 0 and end at x + 34 <= w + 18 in row y + 3
    // <= h - 11, that is, before the end of row h - 10.
    let s = unsafe { five_scores_avx2(image, x, y) };
    [s[0], s[1], s[2], s[3], s[4]]
}

/// # Safety
/// AVX2 must be available, and the bounds that [`five_scores`] asserts must hold.
#[target_feature(enable = "avx2")]
unsafe fn five_scores_avx2(image: &GrayImage, x: usize, y: usize) -> [u8; 32] {
    let offsets = CIRCLE.map(|[dx, dy]| dy * image.width() as isize + dx);
    let mut out = [0u8; 32];
    // SAFETY: see `five_scores`; `out` is 32 bytes long.
    unsafe {
        let centre = image.data().as_ptr().add(y * image.width() + x);
        let s = score_block(centre, &offsets, _mm256_setzero_si256());
        _mm256_storeu_si256(out.as_mut_ptr() as *mut __m256i, s);
    }
    out
}

/// Scores of the 32 pixels starting at `centre`.
///
/// # Safety
/// AVX2 must be available; 32 bytes must be readable at `centre` and at each offset from it.
#[target_feature(enable = "avx2")]
#[inline]
unsafe fn score_block(centre: *const u8, offsets: &[isize; 16], limit: __m256i) -> __m256i {
    let zero = _mm256_setzero_si256();
    // SAFETY: guaranteed by the caller.
    let at = |k: usize| unsafe { _mm256_loadu_si256(centre.offset(offsets[k]) as *const __m256i) };
    // SAFETY: guaranteed by the caller.
    let c = unsafe { _mm256_loadu_si256(centre as *const __m256i) };

    // Nine contiguous pixels contain two adjacent ones of the four compass points and two of the four diagonals: both
    // bound the score.
    let bound = |a, b, c4, d| {
        let most = _mm256_min_epu8(_mm256_max_epu8(a, c4), _mm256_max_epu8(b, d));
        let least = _mm256_max_epu8(_mm256_min_epu8(a, c4), _mm256_min_epu8(b, d));
        _mm256_max_epu8(_mm256_subs_epu8(most, c), _mm256_subs_epu8(c, least))
    };
    let (p0, p4, p8, p12) = (at(0), at(4), at(8), at(12));
    let compass = bound(p0, p4, p8, p12);
    let over = _mm256_subs_epu8(compass, limit);
    if _mm256_testz_si256(over, over) == 1 {
        return zero;
    }
    let (p2, p6, p10, p14) = (at(2), at(6), at(10), at(14));
    let over = _mm256_subs_epu8(_mm256_min_epu8(compass, bound(p2, p6, p10, p14)), limit);
    if _mm256_testz_si256(over, over) == 1 {
        return zero;
    }
    let p = [p0, at(1), p2, at(3), p4, at(5), p6, at(7), p8, at(9), p10, at(11), p12, at(13), p14, at(15)];
    let s = _mm256_max_epu8(_mm256_subs_epu8(brightest(&p), c), _mm256_subs_epu8(c, darkest(&p)));
    let below = _mm256_cmpeq_epi8(_mm256_subs_epu8(s, limit), zero);
    _mm256_andnot_si256(below, s)
}

macro_rules! arcs {
    ($name:ident, $within:ident, $across:ident, $what:literal) => {
        #[doc = $what]
        #[target_feature(enable = "avx2")]
        #[inline]
        fn $name(p: &[__m256i; 16]) -> __m256i {
            // Runs of two from odd positions, then of four, then of eight.
            let two: [__m256i; 8] = std::array::from_fn(|i| $within(p[2 * i + 1], p[(2 * i + 2) & 15]));
            let four: [__m256i; 8] = std::array::from_fn(|i| $within(two[i], two[(i + 1) & 7]));
            let mut best = None;
            for i in 0..8 {
                let eight = $within(four[i], four[(i + 2) & 7]);
                let ends = $across(p[2 * i], p[(2 * i + 9) & 15]);
                let nine = $within(eight, ends);
                best = Some(match best {
                    None => nine,
                    Some(b) => $across(b, nine),
                });
            }
            best.unwrap_or(p[0])
        }
    };
}
arcs!(brightest, _mm256_min_epu8, _mm256_max_epu8, "Maximum over the arcs of nine of the minimum in each.");
arcs!(darkest, _mm256_max_epu8, _mm256_min_epu8, "Minimum over the arcs of nine of the maximum in each.");

/// Non-maximum suppression in the middle of three rows of scores; rows are readable 31 bytes beyond `x1`.
pub(super) fn peaks(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>) {
    assert!(x0 >= 1 && rows.iter().all(|r| r.len() >= x1 + 32));
    assert!(is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; blocks start at x0 - 1 >= 0 and the last, at x1 - 1 at most, reads to x1 + 31.
    unsafe { peaks_avx2(rows, y, x0, x1, out) }
}

/// # Safety
/// AVX2 must be available, and the bounds that [`peaks`] asserts must hold.
#[target_feature(enable = "avx2")]
unsafe fn peaks_avx2(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>) {
    let [above, here, below] = rows;
    // SAFETY: `x` is in the rows' bounds as asserted by `peaks`.
    let load = |row: &[u8], x: usize| unsafe { _mm256_loadu_si256(row.as_ptr().add(x) as *const __m256i) };
    let mut x = x0;
    while x < x1 {
        let s = load(here, x);
        if _mm256_testz_si256(s, s) == 0 {
            let up = _mm256_max_epu8(load(above, x - 1), _mm256_max_epu8(load(above, x), load(above, x + 1)));
            let down =
                _mm256_max_epu8(load(below, x - 1), _mm256_max_epu8(load(below, x), load(below, x + 1)));
            let before = _mm256_max_epu8(up, load(here, x - 1));
            let after = _mm256_max_epu8(down, load(here, x + 1));
            let no = _mm256_cmpeq_epi8(_mm256_subs_epu8(s, before), _mm256_setzero_si256());
            let yes = _mm256_cmpeq_epi8(_mm256_max_epu8(s, after), s);
            let mut bits = _mm256_movemask_epi8(_mm256_andnot_si256(no, yes)) as u32;
            if x1 - x < 32 {
                bits &= (1 << (x1 - x)) - 1;
            }
            while bits != 0 {
                let at = x + bits.trailing_zeros() as usize;
                out.push(Corner { x: at as u16, y: y as u16, score: here[at] });
                bits &= bits - 1;
            }
        }
        x += 32;
    }
}
