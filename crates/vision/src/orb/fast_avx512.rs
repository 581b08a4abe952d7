//! AVX-512 version of [`super::fast`] and [`super::fast_score`]: 64 pixels at a time, bit-identical.
#![allow(unsafe_code)]

use super::BORDER;
use super::fast_scalar::{CELL, CIRCLE, Corner};
use cairn_sensor::GrayImage;
use std::arch::x86_64::*;

/// Pixels of a block: two cells.
const BLOCK: usize = 2 * CELL;

/// See [`super::fast_score::score_row`].
pub(super) fn score_row(image: &GrayImage, y: usize, x0: usize, thresholds: &[u8], out: &mut [u8]) {
    let (w, h) = (image.width(), image.height());
    let end = x0 + thresholds.len() * CELL;
    assert!(w > 2 * BORDER && h > 2 * BORDER, "image smaller than a patch");
    assert!(x0 >= 3 && end <= w + CELL && y >= 3 && y + BORDER <= h && out.len() >= end);
    assert!(super::Backend::Avx512.available());
    let (pairs, last) = thresholds.as_chunks::<2>();
    // SAFETY: the instructions are available. The first block reads from x0 - 3 >= 0 in row y - 3 >= 0 on; the last
    // reads up to column end + 3 <= w + 35 in row y + 3 <= h - 13, that is, before the end of row h - 11. Writes end at
    // `end`.
    unsafe { score_row_avx512(image, y, x0, pairs, out) }
    if !last.is_empty() {
        super::fast_avx2::score_row(image, y, x0 + pairs.len() * BLOCK, last, out);
    }
}

/// # Safety
/// AVX-512 F and BW must be available, and the bounds that [`score_row`] asserts must hold.
#[target_feature(enable = "avx512f,avx512bw")]
unsafe fn score_row_avx512(image: &GrayImage, y: usize, x0: usize, thresholds: &[[u8; 2]], out: &mut [u8]) {
    let offsets = CIRCLE.map(|[dx, dy]| dy * image.width() as isize + dx);
    for (pair, &[left, right]) in thresholds.iter().enumerate() {
        let x = x0 + pair * BLOCK;
        let limit = _mm512_inserti64x4::<1>(
            _mm512_castsi256_si512(_mm256_set1_epi8(left as i8)),
            _mm256_set1_epi8(right as i8),
        );
        // SAFETY: see `score_row`.
        unsafe {
            let s = score_block(image.data().as_ptr().add(y * image.width() + x), &offsets, limit);
            _mm512_storeu_si512(out.as_mut_ptr().add(x) as *mut __m512i, s);
        }
    }
}

/// Scores of the 64 pixels starting at `centre`; zero at or below the limit.
///
/// # Safety
/// AVX-512 F and BW must be available; 64 bytes must be readable at `centre` and at each offset from it.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
unsafe fn score_block(centre: *const u8, offsets: &[isize; 16], limit: __m512i) -> __m512i {
    // SAFETY: guaranteed by the caller.
    let at = |k: usize| unsafe { _mm512_loadu_si512(centre.offset(offsets[k]) as *const __m512i) };
    // SAFETY: guaranteed by the caller.
    let c = unsafe { _mm512_loadu_si512(centre as *const __m512i) };
    // Nine contiguous pixels contain two adjacent ones of the four compass points and two of the four diagonals: both
    // bound the score.
    let bound = |a, b, c4, d| {
        let most = _mm512_min_epu8(_mm512_max_epu8(a, c4), _mm512_max_epu8(b, d));
        let least = _mm512_max_epu8(_mm512_min_epu8(a, c4), _mm512_min_epu8(b, d));
        _mm512_max_epu8(_mm512_subs_epu8(most, c), _mm512_subs_epu8(c, least))
    };
    let (p0, p4, p8, p12) = (at(0), at(4), at(8), at(12));
    let over = _mm512_cmpgt_epu8_mask(bound(p0, p4, p8, p12), limit);
    if over == 0 {
        return _mm512_setzero_si512();
    }
    let (p2, p6, p10, p14) = (at(2), at(6), at(10), at(14));
    if over & _mm512_cmpgt_epu8_mask(bound(p2, p6, p10, p14), limit) == 0 {
        return _mm512_setzero_si512();
    }
    let p = [p0, at(1), p2, at(3), p4, at(5), p6, at(7), p8, at(9), p10, at(11), p12, at(13), p14, at(15)];
    let s = score(&p, c);
    _mm512_maskz_mov_epi8(_mm512_cmpgt_epu8_mask(s, limit), s)
}

/// Scores of pixels `c` with the circles `p` around them.
#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn score(p: &[__m512i; 16], c: __m512i) -> __m512i {
    _mm512_max_epu8(_mm512_subs_epu8(brightest(p), c), _mm512_subs_epu8(c, darkest(p)))
}

macro_rules! arcs {
    ($name:ident, $within:ident, $across:ident, $what:literal) => {
        #[doc = $what]
        #[target_feature(enable = "avx512f,avx512bw")]
        #[inline]
        fn $name(p: &[__m512i; 16]) -> __m512i {
            // Runs of two from odd positions, then of four, then of eight.
            let two: [__m512i; 8] = std::array::from_fn(|i| $within(p[2 * i + 1], p[(2 * i + 2) & 15]));
            let four: [__m512i; 8] = std::array::from_fn(|i| $within(two[i], two[(i + 1) & 7]));
            let nine = |i: usize| {
                let eight = $within(four[i], four[(i + 2) & 7]);
                $within(eight, $across(p[2 * i], p[(2 * i + 9) & 15]))
            };
            (1..8).fold(nine(0), |best, i| $across(best, nine(i)))
        }
    };
}
arcs!(brightest, _mm512_min_epu8, _mm512_max_epu8, "Maximum over the arcs of nine of the minimum in each.");
arcs!(darkest, _mm512_max_epu8, _mm512_min_epu8, "Minimum over the arcs of nine of the maximum in each.");

/// Side of the patch that the scores of 5 x 5 pixels depend on.
const PATCH: usize = 11;

/// Where in the patch the centres of the 25 pixels are (last), and the sixteen pixels around each.
static AROUND: [[u8; 64]; 17] = {
    let mut out = [[0; 64]; 17];
    let mut k = 0;
    while k < 17 {
        let [dx, dy] = if k < 16 { CIRCLE[k] } else { [0, 0] };
        let mut i = 0;
        while i < 25 {
            let (x, y) = ((i % 5) as isize + 3 + dx, (i / 5) as isize + 3 + dy);
            out[k][i] = (y * PATCH as isize + x) as u8;
            i += 1;
        }
        k += 1;
    }
    out
};

/// See [`super::fast_score::scores_around`].
pub(super) fn scores_around(image: &GrayImage, x: usize, y: usize) -> [[u8; 5]; 5] {
    let (w, h) = (image.width(), image.height());
    assert!(x >= 5 && y >= 5 && x + 11 <= w && y + 6 <= h && super::Backend::Avx512.available());
    // SAFETY: the instructions are available; the rows y - 5 to y + 5 are read from column x - 5 to x + 10.
    let s = unsafe { scores_around_avx512(image, x, y) };
    std::array::from_fn(|v| std::array::from_fn(|u| s[v * 5 + u]))
}

/// # Safety
/// AVX-512 F, BW and VBMI must be available, and the bounds that [`scores_around`] asserts must hold.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi")]
unsafe fn scores_around_avx512(image: &GrayImage, x: usize, y: usize) -> [u8; 64] {
    let mut patch = [0u8; 128];
    let mut out = [0u8; 64];
    // SAFETY: sixteen bytes are read from each row as the caller guarantees; the last are written at 110 to 125. The next
    // row overwrites what is written beyond the eleventh column.
    unsafe {
        let first = image.data().as_ptr().add((y - 5) * image.width() + x - 5);
        for row in 0..PATCH {
            let pixels = _mm_loadu_si128(first.add(row * image.width()) as *const __m128i);
            _mm_storeu_si128(patch.as_mut_ptr().add(row * PATCH) as *mut __m128i, pixels);
        }
        let low = _mm512_loadu_si512(patch.as_ptr() as *const __m512i);
        let high = _mm512_loadu_si512(patch.as_ptr().add(64) as *const __m512i);
        let at = |k: usize| {
            let places = _mm512_loadu_si512(AROUND[k].as_ptr() as *const __m512i);
            _mm512_permutex2var_epi8(low, places, high)
        };
        let circle: [__m512i; 16] = std::array::from_fn(at);
        _mm512_storeu_si512(out.as_mut_ptr() as *mut __m512i, score(&circle, at(16)));
    }
    out
}

/// Non-maximum suppression in the middle of three rows of scores; rows are readable 63 bytes beyond `x1`.
pub(super) fn peaks(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>) {
    assert!(x0 >= 1 && rows.iter().all(|r| r.len() >= x1 + BLOCK));
    assert!(super::Backend::Avx512.available());
    // SAFETY: the instructions are available; blocks start at x0 - 1 >= 0 and the last, at x1 - 1 at most, reads to
    // x1 + 63.
    unsafe { peaks_avx512(rows, y, x0, x1, out) }
}

/// # Safety
/// AVX-512 F and BW must be available, and the bounds that [`peaks`] asserts must hold.
#[target_feature(enable = "avx512f,avx512bw")]
unsafe fn peaks_avx512(rows: [&[u8]; 3], y: usize, x0: usize, x1: usize, out: &mut Vec<Corner>) {
    let [above, here, below] = rows;
    // SAFETY: `x` is in the rows' bounds as asserted by `peaks`.
    let load = |row: &[u8], x: usize| unsafe { _mm512_loadu_si512(row.as_ptr().add(x) as *const __m512i) };
    for x in (x0..x1).step_by(BLOCK) {
        let s = load(here, x);
        if _mm512_test_epi8_mask(s, s) == 0 {
            continue;
        }
        let three =
            |row, x| _mm512_max_epu8(load(row, x - 1), _mm512_max_epu8(load(row, x), load(row, x + 1)));
        let before = _mm512_max_epu8(three(above, x), load(here, x - 1));
        let after = _mm512_max_epu8(three(below, x), load(here, x + 1));
        let mut bits = _mm512_cmpgt_epu8_mask(s, before) & _mm512_cmpge_epu8_mask(s, after);
        if x1 - x < BLOCK {
            bits &= (1 << (x1 - x)) - 1;
        }
        while bits != 0 {
            let at = x + bits.trailing_zeros() as usize;
            out.push(Corner { x: at as u16, y: y as u16, score: here[at] });
            bits &= bits - 1;
        }
    }
}
