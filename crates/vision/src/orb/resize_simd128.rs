//! WebAssembly's version of the pass over columns of [`super::resize`], bit-identical.
#![allow(unsafe_code)]

use super::resize_scalar::{TAPS, Tap};
use std::arch::wasm32::*;

/// Eight destination pixels, computed from sixteen consecutive source pixels.
#[derive(Clone, Debug)]
pub(super) struct Block {
    /// First source pixel.
    base: usize,
    /// For taps 0 and 1, then 2 and 3: the source bytes of the eight pixels' first tap, then of their second.
    pick: [[u8; 16]; 2],
    weights: [[u8; 16]; 2],
}

/// Blocks for all full groups of eight columns; `None` when the ratio maps eight pixels to more than sixteen.
pub(super) fn plan(columns: &[Tap]) -> Option<Vec<Block>> {
    columns.chunks_exact(8).map(block).collect()
}

fn block(taps: &[Tap]) -> Option<Block> {
    let mut block = Block { base: taps[0].start, pick: [[0; 16]; 2], weights: [[0; 16]; 2] };
    for (i, tap) in taps.iter().enumerate() {
        let first = tap.start.checked_sub(block.base)?;
        if first + TAPS > 16 {
            return None;
        }
        for k in 0..TAPS {
            block.pick[k / 2][k % 2 * 8 + i] = (first + k) as u8;
            block.weights[k / 2][k % 2 * 8 + i] = tap.weights[k];
        }
    }
    Some(block)
}

/// Weighted sums of neighbours in `row`, by blocks made of these `columns`.
pub(super) fn combine_columns(row: &[u8], blocks: &[Block], columns: &[Tap], out: &mut [u8]) {
    for (block, out) in blocks.iter().zip(out.chunks_exact_mut(8)) {
        let source = load(&row[block.base..block.base + 16]);
        let part = |k: usize| {
            let (picked, weights) = (u8x16_swizzle(source, load(&block.pick[k])), load(&block.weights[k]));
            u16x8_add(u16x8_extmul_low_u8x16(picked, weights), u16x8_extmul_high_u8x16(picked, weights))
        };
        let sum = u16x8_shr(u16x8_add(u16x8_add(part(0), part(1)), u16x8_splat(64)), 7);
        out.copy_from_slice(&i64x2_extract_lane::<0>(u8x16_narrow_i16x8(sum, sum)).to_le_bytes());
    }
    super::resize_scalar::combine_columns(row, columns, out, blocks.len() * 8);
}

fn load(bytes: &[u8]) -> v128 {
    assert!(bytes.len() >= 16);
    // SAFETY: sixteen bytes can be read, from any address.
    unsafe { v128_load(bytes.as_ptr() as *const v128) }
}
