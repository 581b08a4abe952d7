//! Versions of the loops in [`super::blocks`] with the instructions of [`crate::Backend::Avx512`]: the same results.
#![allow(unsafe_code)]

use super::block::{BLOCK, add_block, width_of, write_block};
use std::arch::x86_64::*;

/// Adds a row's differences to the numbers above, as [`super::blocks`] does, two blocks at once.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx2,bmi2")]
pub unsafe fn add_row(bytes: &[u8], widths: &[u8], above: &mut [[u16; BLOCK]]) -> Option<(usize, u16)> {
    let (mut at, mut largest) = (0, _mm256_setzero_si256());
    let (pairs, rest) = above.as_chunks_mut();
    for (pair, codes) in pairs.iter_mut().zip(widths) {
        // SAFETY: of the caller.
        let numbers = unsafe { add_pair(bytes, &mut at, *codes, pair)? };
        largest = _mm256_max_epu16(largest, numbers);
    }
    // SAFETY: of the caller.
    let mut largest = unsafe { greatest(largest) };
    if let ([numbers], Some(codes)) = (rest, widths.last()) {
        at += add_block(bytes.get(at..)?, width_of(codes & 15), numbers)?;
        largest = largest.max(numbers.iter().copied().max()?);
    }
    Some((at, largest))
}

/// Adds the differences of two blocks that begin at a place, which moves on behind them. One instruction spreads the bits of a block to
/// bytes, where the eight bytes at hand have both blocks.
///
/// # Safety
/// The instructions must be available.
#[inline]
#[target_feature(enable = "avx2,bmi2")]
unsafe fn add_pair(
    bytes: &[u8],
    at: &mut usize,
    codes: u8,
    numbers: &mut [[u16; BLOCK]; 2],
) -> Option<__m256i> {
    let pair = &PAIRS[usize::from(codes)];
    let word = bytes.get(*at..).and_then(|rest| rest.first_chunk()).filter(|_| pair.bytes <= 8);
    let Some(word) = word else {
        add_each(bytes, at, codes, numbers)?;
        // SAFETY: sixteen numbers are there.
        return Some(unsafe { _mm256_loadu_si256(numbers.as_ptr().cast()) });
    };
    let word = u64::from_le_bytes(*word);
    *at += usize::from(pair.bytes);
    let first = _pdep_u64(word, pair.lanes[0]);
    // Where the first takes all eight, the second has no lanes.
    let second = _pdep_u64(word >> (pair.second & 63), pair.lanes[1]);
    let steps = _mm256_cvtepu8_epi16(_mm_set_epi64x(second as i64, first as i64));
    let sign = _mm256_sub_epi16(_mm256_setzero_si256(), _mm256_and_si256(steps, _mm256_set1_epi16(1)));
    let steps = _mm256_xor_si256(_mm256_srli_epi16::<1>(steps), sign);
    let to: *mut __m256i = numbers.as_mut_ptr().cast();
    // SAFETY: sixteen numbers are there.
    unsafe {
        let numbers = _mm256_add_epi16(_mm256_loadu_si256(to), steps);
        _mm256_storeu_si256(to, numbers);
        Some(numbers)
    }
}

/// The same for blocks with more bytes, and at the end of the bytes.
#[cold]
fn add_each(bytes: &[u8], at: &mut usize, codes: u8, numbers: &mut [[u16; BLOCK]; 2]) -> Option<()> {
    for (numbers, code) in numbers.iter_mut().zip([codes & 15, codes >> 4]) {
        *at += add_block(bytes.get(*at..)?, width_of(code), numbers)?;
    }
    Some(())
}

/// The greatest of sixteen numbers.
///
/// # Safety
/// The instructions must be available.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn greatest(numbers: __m256i) -> u16 {
    let mut lanes = [0u16; 2 * BLOCK];
    // SAFETY: there is room for sixteen numbers.
    unsafe { _mm256_storeu_si256(lanes.as_mut_ptr().cast(), numbers) };
    lanes.into_iter().fold(0, u16::max)
}

/// Two blocks of at most eight bits each, by their codes.
#[derive(Clone, Copy)]
struct Pair {
    /// Bytes of both; more than eight where they cannot be read as one word.
    bytes: u8,
    /// Where the bits of the second begin.
    second: u8,
    /// Where the bits of a difference belong in each of eight bytes.
    lanes: [u64; 2],
}

const PAIRS: [Pair; 256] = {
    let mut out = [Pair { bytes: 0, second: 0, lanes: [0; 2] }; 256];
    let mut codes = 0;
    while codes < 256 {
        let bits = [width_of(codes as u8 & 15), width_of(codes as u8 >> 4)];
        let mut k = 0;
        while k < 2 {
            if bits[k] <= 8 {
                out[codes].lanes[k] = ((1 << bits[k]) - 1) * 0x0101_0101_0101_0101;
            }
            k += 1;
        }
        out[codes].bytes = (bits[0] + bits[1]) as u8;
        out[codes].second = (8 * bits[0]) as u8;
        codes += 1;
    }
    out
};

/// Writes what a table has for each number, and `none` where the masks have no bit. Numbers of pixels side by side are near each other:
/// 32 entries of the table around the first of sixteen nearly always have all of them.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx512f,avx512bw,avx512vl,bmi1")]
pub unsafe fn look_up(
    row: &mut [u32],
    numbers: &[[u16; BLOCK]],
    masks: &[u8],
    table: &[u32; 1 << 16],
    none: u32,
) {
    const PIXELS: usize = 2 * BLOCK;
    const WINDOW: usize = 32;
    let (most, nothing) = (_mm256_set1_epi16(WINDOW as i16 - 1), _mm512_set1_epi32(none as i32));
    let mut pixels = row.chunks_exact_mut(PIXELS);
    let mut blocks = numbers.chunks(2).zip(masks.chunks(2));
    for (pixels, (numbers, masks)) in pixels.by_ref().zip(blocks.by_ref()) {
        let mask = u16::from_le_bytes([masks[0], masks[1]]);
        let first = numbers.as_flattened()[mask.trailing_zeros() as usize % PIXELS];
        let base = usize::from(first).saturating_sub(WINDOW / 2).min(table.len() - WINDOW);
        // SAFETY: there are sixteen numbers and pixels, 32 entries of the table from `base` on, and one for every number.
        unsafe {
            let numbers = _mm256_loadu_si256(numbers.as_ptr().cast());
            let at = _mm256_sub_epi16(numbers, _mm256_set1_epi16(base as i16));
            let found = if _mm256_mask_cmpgt_epu16_mask(mask, at, most) == 0 {
                let window: *const __m512i = table.as_ptr().add(base).cast();
                let (low, high) = (_mm512_loadu_si512(window), _mm512_loadu_si512(window.add(1)));
                let found = _mm512_permutex2var_epi32(low, _mm512_cvtepu16_epi32(at), high);
                _mm512_mask_mov_epi32(nothing, mask, found)
            } else {
                let at = _mm512_cvtepu16_epi32(numbers);
                _mm512_mask_i32gather_epi32::<4>(nothing, mask, at, table.as_ptr().cast())
            };
            _mm512_storeu_si512(pixels.as_mut_ptr().cast(), found);
        }
    }
    // Less than sixteen pixels are left.
    let Some((numbers, masks)) = blocks.next() else { return };
    for ((pixels, numbers), mask) in pixels.into_remainder().chunks_mut(BLOCK).zip(numbers).zip(masks) {
        write_block(pixels, numbers, *mask, table, none);
    }
}
