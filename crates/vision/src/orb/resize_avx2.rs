//! AVX2 version of [`super::resize`], bit-identical.
#![allow(unsafe_code)]

use super::resize_scalar::{TAPS, Tap};
use std::arch::x86_64::*;

/// Sixteen destination pixels: each half of eight is computed from sixteen consecutive source pixels.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// First source pixel of each half.
    base: [usize; 2],
    /// For taps 0 and 1, then 2 and 3: the source byte of each position, and its weight.
    pick: [[u8; 32]; 2],
    weights: [[u8; 32]; 2],
}

/// Blocks for all full groups of sixteen columns; `None` when the ratio maps eight pixels to more than sixteen.
pub(super) fn plan(columns: &[Tap]) -> Option<Vec<Block>> {
    columns.chunks_exact(16).map(block).collect()
}

fn block(taps: &[Tap]) -> Option<Block> {
    let base = [taps[0].start, taps[8].start];
    let mut block = Block { base, pick: [[0; 32]; 2], weights: [[0; 32]; 2] };
    for (i, tap) in taps.iter().enumerate() {
        let first = tap.start.checked_sub(base[i / 8])?;
        if first + TAPS > 16 {
            return None;
        }
        for k in 0..TAPS {
            block.pick[k / 2][2 * i + k % 2] = (first + k) as u8;
            block.weights[k / 2][2 * i + k % 2] = tap.weights[k];
        }
    }
    Some(block)
}

/// Weighted sum of four rows of equal length into `out`, which is at least as long.
pub(super) fn combine_rows(rows: [&[u8]; TAPS], weights: [u8; TAPS], out: &mut [u8]) {
    let n = rows[0].len();
    assert!(rows.iter().all(|r| r.len() == n) && out.len() >= n && is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; all blocks of 32 end at n at most.
    unsafe { combine_rows_avx2(rows, weights, out) };
    super::resize_scalar::combine_rows(rows, weights, out, n / 32 * 32);
}

/// # Safety
/// AVX2 must be available, all rows as long as the first, `out` no shorter.
#[target_feature(enable = "avx2")]
unsafe fn combine_rows_avx2(rows: [&[u8]; TAPS], weights: [u8; TAPS], out: &mut [u8]) {
    let pair = |k: usize| _mm256_set1_epi16(i16::from_le_bytes([weights[k], weights[k + 1]]));
    let (w01, w23) = (pair(0), pair(2));
    let round = _mm256_set1_epi16(64);
    for x in (0..rows[0].len() / 32 * 32).step_by(32) {
        // SAFETY: x + 32 <= length of every row.
        let load = |k: usize| unsafe { _mm256_loadu_si256(rows[k].as_ptr().add(x) as *const __m256i) };
        let (a, b, c, d) = (load(0), load(1), load(2), load(3));
        let low = _mm256_add_epi16(
            _mm256_maddubs_epi16(_mm256_unpacklo_epi8(a, b), w01),
            _mm256_maddubs_epi16(_mm256_unpacklo_epi8(c, d), w23),
        );
        let high = _mm256_add_epi16(
            _mm256_maddubs_epi16(_mm256_unpackhi_epi8(a, b), w01),
            _mm256_maddubs_epi16(_mm256_unpackhi_epi8(c, d), w23),
        );
        let low = _mm256_srli_epi16(_mm256_add_epi16(low, round), 7);
        let high = _mm256_srli_epi16(_mm256_add_epi16(high, round), 7);
        // SAFETY: x + 32 <= out.len().
        unsafe {
            _mm256_storeu_si256(out.as_mut_ptr().add(x) as *mut __m256i, _mm256_packus_epi16(low, high))
        };
    }
}

/// Weighted sums of neighbours in `row`, by blocks made of these `columns`.
pub(super) fn combine_columns(row: &[u8], blocks: &[Block], columns: &[Tap], out: &mut [u8]) {
    assert!(out.len() >= blocks.len() * 16 && is_x86_feature_detected!("avx2"));
    assert!(blocks.iter().all(|b| b.base[0].max(b.base[1]) + 16 <= row.len()));
    // SAFETY: AVX2 is available; every block reads sixteen bytes from its bases and writes its own sixteen.
    unsafe { combine_columns_avx2(row, blocks, out) };
    super::resize_scalar::combine_columns(row, columns, out, blocks.len() * 16);
}

/// # Safety
/// AVX2 must be available; the bounds that [`combine_columns`] asserts must hold.
#[target_feature(enable = "avx2")]
unsafe fn combine_columns_avx2(row: &[u8], blocks: &[Block], out: &mut [u8]) {
    let round = _mm256_set1_epi16(64);
    for (i, block) in blocks.iter().enumerate() {
        // SAFETY: bases + 16 <= row.len(); the tables are 32 bytes long; out holds 16 per block.
        unsafe {
            let half = |k: usize| _mm_loadu_si128(row.as_ptr().add(block.base[k]) as *const __m128i);
            let table = |t: &[u8; 32]| _mm256_loadu_si256(t.as_ptr() as *const __m256i);
            let source = _mm256_set_m128i(half(1), half(0));
            let part = |k: usize| {
                let picked = _mm256_shuffle_epi8(source, table(&block.pick[k]));
                _mm256_maddubs_epi16(picked, table(&block.weights[k]))
            };
            let sum = _mm256_add_epi16(_mm256_add_epi16(part(0), part(1)), round);
            let sum = _mm256_srli_epi16(sum, 7);
            let packed = _mm_packus_epi16(_mm256_castsi256_si128(sum), _mm256_extracti128_si256(sum, 1));
            _mm_storeu_si128(out.as_mut_ptr().add(i * 16) as *mut __m128i, packed);
        }
    }
}
