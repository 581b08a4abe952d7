//! AVX2 version of [`super::blur`], bit-identical.
#![allow(unsafe_code)]

use super::blur_scalar::KERNEL;
use std::arch::x86_64::*;

/// Vertical pass over rows of equal length into `out`, which is at least as long.
pub(super) fn columns(rows: [&[u8]; 7], out: &mut [u8]) {
    let n = rows[0].len();
    assert!(rows.iter().all(|r| r.len() == n) && out.len() >= n && is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; all blocks of 32 end at n at most.
    unsafe { columns_avx2(rows, out) };
    super::blur_scalar::columns(rows, out, n / 32 * 32);
}

fn pair(a: u8, b: u8) -> i16 {
    i16::from_le_bytes([a, b])
}

/// # Safety
/// AVX2 must be available, all rows as long as the first, `out` no shorter.
#[target_feature(enable = "avx2")]
unsafe fn columns_avx2(rows: [&[u8]; 7], out: &mut [u8]) {
    let weight = |k: usize| _mm256_set1_epi16(pair(KERNEL[k], KERNEL[k]));
    let (k0, k1, k2) = (weight(0), weight(1), weight(2));
    // The middle row is paired with a row of ones, whose weight is the rounding term.
    let (k3, one) = (_mm256_set1_epi16(pair(KERNEL[3], 64)), _mm256_set1_epi8(1));
    for x in (0..rows[0].len() / 32 * 32).step_by(32) {
        // SAFETY: x + 32 <= length of every row.
        let r = |k: usize| unsafe { _mm256_loadu_si256(rows[k].as_ptr().add(x) as *const __m256i) };
        let pairs = [(r(0), r(6), k0), (r(1), r(5), k1), (r(2), r(4), k2), (r(3), one, k3)];
        let low = pairs.map(|(a, b, k)| _mm256_maddubs_epi16(_mm256_unpacklo_epi8(a, b), k));
        let high = pairs.map(|(a, b, k)| _mm256_maddubs_epi16(_mm256_unpackhi_epi8(a, b), k));
        let packed = _mm256_packus_epi16(sum_and_shift(low), sum_and_shift(high));
        // SAFETY: x + 32 <= out.len().
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().add(x) as *mut __m256i, packed) };
    }
}

#[target_feature(enable = "avx2")]
#[inline]
fn sum_and_shift(parts: [__m256i; 4]) -> __m256i {
    let [a, b, c, d] = parts;
    _mm256_srli_epi16(_mm256_add_epi16(_mm256_add_epi16(a, b), _mm256_add_epi16(c, d)), 7)
}

/// Horizontal pass: `n` output pixels, where pixel `x` is computed from scratch pixels `x` to `x + 6`. Both slices need
/// at least 32 bytes of padding at the end, which are overwritten in `out`.
pub(super) fn row(scratch: &[u8], out: &mut [u8], n: usize) {
    assert!(scratch.len() >= n + 38 && out.len() >= n + 31 && is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; the last block starts at n - 1 at most, reads to n + 37 and writes to n + 30.
    unsafe { row_avx2(scratch, out, n) }
}

/// # Safety
/// AVX2 must be available; the lengths that [`row`] asserts must hold.
#[target_feature(enable = "avx2")]
unsafe fn row_avx2(scratch: &[u8], out: &mut [u8], n: usize) {
    let [a, b, c, d] = KERNEL;
    let weights = [pair(a, b), pair(c, d), pair(c, b), pair(a, 0)].map(|w| _mm256_set1_epi16(w));
    let round = _mm256_set1_epi16(64);
    for x in (0..n).step_by(32) {
        // SAFETY: see `row`.
        let load = |at: usize| unsafe { _mm256_loadu_si256(scratch.as_ptr().add(at) as *const __m256i) };
        // Neighbouring pairs are summed in place: first for even pixels, then for odd ones.
        let part = |at: usize, k: usize| _mm256_maddubs_epi16(load(at + 2 * k), weights[k]);
        let sum = |at: usize| {
            let outer = _mm256_add_epi16(part(at, 0), part(at, 3));
            let inner = _mm256_add_epi16(part(at, 1), part(at, 2));
            _mm256_add_epi16(_mm256_add_epi16(outer, inner), round)
        };
        let even = _mm256_srli_epi16(sum(x), 7);
        let odd = _mm256_slli_epi16(_mm256_srli_epi16(sum(x + 1), 7), 8);
        // SAFETY: see `row`.
        unsafe { _mm256_storeu_si256(out.as_mut_ptr().add(x) as *mut __m256i, _mm256_or_si256(even, odd)) };
    }
}
