//! Versions of the loops in [`super::blocks`] with the instructions of [`crate::Backend::Avx512`]: the same results.
#![allow(unsafe_code)]

use super::block::{BLOCK, MOST_BYTES, block_at, width_of, write_block};
use std::arch::x86_64::*;

/// Adds a row's differences to the numbers above, as [`super::blocks`] does: one instruction spreads the bits of four differences.
///
/// # Safety
/// The instructions must be available.
#[target_feature(enable = "avx,sse4.1,bmi2")]
pub unsafe fn add_row(bytes: &[u8], widths: &[u8], above: &mut [[u16; BLOCK]]) -> Option<(usize, u16)> {
    let mut at = 0;
    let (mut largest, one) = (_mm_setzero_si128(), _mm_set1_epi16(1));
    for (i, above) in above.iter_mut().enumerate() {
        let code = widths[i / 2] >> (i % 2 * 4) & 15;
        let (bits, lanes) = CODES[usize::from(code)];
        let padded;
        // The second four begin in the middle of a byte where the width is odd.
        let block = match bytes.get(at..at + MOST_BYTES) {
            Some(block) => block,
            None => {
                padded = block_at(bytes, at, bits)?;
                &padded
            }
        };
        at += bits;
        let (first, second) = (block.first_chunk()?, block.get(bits / 2..bits / 2 + 8)?.first_chunk()?);
        let first = _pdep_u64(u64::from_le_bytes(*first), lanes);
        let second = _pdep_u64(u64::from_le_bytes(*second) >> (bits % 2 * 4), lanes);
        let steps = _mm_set_epi64x(second as i64, first as i64);
        let sign = _mm_sub_epi16(_mm_setzero_si128(), _mm_and_si128(steps, one));
        let steps = _mm_xor_si128(_mm_srli_epi16::<1>(steps), sign);
        let to: *mut __m128i = above.as_mut_ptr().cast();
        // SAFETY: eight numbers are there.
        unsafe {
            let numbers = _mm_add_epi16(_mm_loadu_si128(to), steps);
            _mm_storeu_si128(to, numbers);
            largest = _mm_max_epu16(largest, numbers);
        }
    }
    let mut lanes = [0u16; BLOCK];
    // SAFETY: eight numbers are there.
    unsafe { _mm_storeu_si128(lanes.as_mut_ptr().cast(), largest) };
    Some((at, lanes.into_iter().max()?))
}

/// By the code of a block: the bits of a difference, and where they belong in four numbers.
const CODES: [(usize, u64); 16] = {
    let mut out = [(0, 0); 16];
    let mut code = 0;
    while code < 16 {
        let bits = width_of(code as u8);
        out[code] = (bits, ((1 << bits) - 1) * 0x0001_0001_0001_0001);
        code += 1;
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
