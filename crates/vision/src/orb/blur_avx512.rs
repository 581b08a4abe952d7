//! AVX-512 version of [`super::blur`], bit-identical.
#![allow(unsafe_code)]

use super::blur_scalar::KERNEL;
use std::arch::x86_64::*;

/// Pixels of a block.
const BLOCK: usize = 64;

/// Vertical pass over rows of equal length into `out`, which is at least as long.
pub(super) fn columns(rows: [&[u8]; 7], out: &mut [u8]) {
    let n = rows[0].len();
    if n < BLOCK {
        return super::blur_avx2::columns(rows, out);
    }
    assert!(rows.iter().all(|r| r.len() == n) && out.len() >= n && super::Backend::Avx512.available());
    // SAFETY: the instructions are available; there is at least one block, and all end at n at most.
    unsafe { columns_avx512(rows, out) };
}

fn pair(a: u8, b: u8) -> i16 {
    i16::from_le_bytes([a, b])
}

/// # Safety
/// AVX-512 F and BW must be available, all rows as long as the first and at least one block long, `out` no
/// shorter.
#[target_feature(enable = "avx512f,avx512bw")]
unsafe fn columns_avx512(rows: [&[u8]; 7], out: &mut [u8]) {
    let weight = |k: usize| _mm512_set1_epi16(pair(KERNEL[k], KERNEL[k]));
    let (k0, k1, k2) = (weight(0), weight(1), weight(2));
    // The middle row is paired with a row of ones, whose weight is the rounding term.
    let (k3, one) = (_mm512_set1_epi16(pair(KERNEL[3], 64)), _mm512_set1_epi8(1));
    let last = rows[0].len() - BLOCK;
    // The last block overlaps the one before it.
    for x in (0..last).step_by(BLOCK).chain([last]) {
        // SAFETY: x + 64 <= length of every row.
        let r = |k: usize| unsafe { _mm512_loadu_si512(rows[k].as_ptr().add(x) as *const __m512i) };
        let pairs = [(r(0), r(6), k0), (r(1), r(5), k1), (r(2), r(4), k2), (r(3), one, k3)];
        let low = pairs.map(|(a, b, k)| _mm512_maddubs_epi16(_mm512_unpacklo_epi8(a, b), k));
        let high = pairs.map(|(a, b, k)| _mm512_maddubs_epi16(_mm512_unpackhi_epi8(a, b), k));
        let packed = _mm512_packus_epi16(sum_and_shift(low), sum_and_shift(high));
        // SAFETY: x + 64 <= out.len().
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().add(x) as *mut __m512i, packed) };
    }
}

#[target_feature(enable = "avx512f,avx512bw")]
#[inline]
fn sum_and_shift(parts: [__m512i; 4]) -> __m512i {
    let [a, b, c, d] = parts;
    _mm512_srli_epi16::<7>(_mm512_add_epi16(_mm512_add_epi16(a, b), _mm512_add_epi16(c, d)))
}

/// Horizontal pass: `n` output pixels, where pixel `x` is computed from scratch pixels `x` to `x + 6`. Both slices need
/// at least 64 bytes of padding at the end, which are overwritten in `out`.
pub(super) fn row(scratch: &[u8], out: &mut [u8], n: usize) {
    assert!(scratch.len() >= n + 70 && out.len() >= n + 63 && super::Backend::Avx512.available());
    // SAFETY: the instructions are available; the last block starts at n - 1 at most, reads to n + 69 and writes to n + 62.
    unsafe { row_avx512(scratch, out, n) }
}

/// # Safety
/// AVX-512 F and BW must be available; the lengths that [`row`] asserts must hold.
#[target_feature(enable = "avx512f,avx512bw")]
unsafe fn row_avx512(scratch: &[u8], out: &mut [u8], n: usize) {
    let [a, b, c, d] = KERNEL;
    let weights = [pair(a, b), pair(c, d), pair(c, b), pair(a, 0)].map(|w| _mm512_set1_epi16(w));
    let round = _mm512_set1_epi16(64);
    for x in (0..n).step_by(BLOCK) {
        // SAFETY: see `row`.
        let load = |at: usize| unsafe { _mm512_loadu_si512(scratch.as_ptr().add(at) as *const __m512i) };
        // Neighbouring pairs are summed in place: first for even pixels, then for odd ones.
        let part = |at: usize, k: usize| _mm512_maddubs_epi16(load(at + 2 * k), weights[k]);
        let sum = |at: usize| {
            let outer = _mm512_add_epi16(part(at, 0), part(at, 3));
            let inner = _mm512_add_epi16(part(at, 1), part(at, 2));
            _mm512_add_epi16(_mm512_add_epi16(outer, inner), round)
        };
        let even = _mm512_srli_epi16::<7>(sum(x));
        let odd = _mm512_slli_epi16::<8>(_mm512_srli_epi16::<7>(sum(x + 1)));
        // SAFETY: see `row`.
        unsafe { _mm512_storeu_si512(out.as_mut_ptr().add(x) as *mut __m512i, _mm512_or_si512(even, odd)) };
    }
}
