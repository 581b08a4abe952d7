//! Differences to the pixel above, packed in blocks of eight pixels with as many bits as the largest needs.
//!
//! Depth cameras that measure disparity give few values (316 in a kitchen image): pixels are numbered by the ordered
//! list of those that occur, so that neighbouring values differ by one however far away they are. The difference to the
//! pixel above depends on no neighbour in its row, so that a row is unpacked eight pixels at a time. Blocks of one
//! width, byte aligned: Lemire and Boytsov, "Decoding billions of integers per second through vectorization" (Software:
//! Practice and Experience 2015), section 4; zigzag as in Wilson, "Fast lossless depth image compression" (ISS 2017).
//!
//! ```text
//! the value without depth u16 (0 or 65535: what occurs more often) | values u32 | the steps between them, LEB128 each
//! for each row:
//!   a bit a block: whether other pixels have depth than above | four bits a block: the width, 15 for 16 bits
//!   for each block with that bit, a byte: the pixels with depth
//!   for each block, as many bytes as its width: zigzag differences of the numbers, modulo 2^16
//! ```
//!
//! Little-endian, lowest bits first. A pixel without depth keeps the number above it. Above the first row all numbers
//! are 0 and all pixels have depth; so they have to the right of the image, in the last block.

use super::block::{BLOCK, add_block, width_of, write_block};
#[cfg(target_arch = "x86_64")]
use super::kernel_x86;
use crate::Backend;
use crate::backend::dispatch;

/// One entry for each value of a pixel.
type Table = Box<[u16; 1 << 16]>;

fn table() -> Option<Table> {
    vec![0u16; 1 << 16].into_boxed_slice().try_into().ok()
}

/// Appends the packed image.
pub fn pack(data: &[u16], width: usize, out: &mut Vec<u8>) {
    let zeros = data.iter().filter(|&&v| v == 0).count();
    let most = data.iter().filter(|&&v| v == u16::MAX).count();
    let none = if most > zeros { u16::MAX } else { 0 };
    out.extend(none.to_le_bytes());
    let Some(numbers) = pack_values(data, none, out) else { return };
    let blocks = width.div_ceil(BLOCK);
    let mut above = vec![([0u16; BLOCK], u8::MAX); blocks];
    let mut payload = Vec::new();
    for row in data.chunks_exact(width.max(1)) {
        let flags = out.len();
        let widths = flags + blocks.div_ceil(8);
        out.resize(widths + blocks.div_ceil(2), 0);
        payload.clear();
        for (i, (pixels, above)) in row.chunks(BLOCK).zip(&mut above).enumerate() {
            let (steps, mask) = differences(pixels, none, &numbers, &mut above.0);
            if mask != above.1 {
                out[flags + i / 8] |= 1 << (i % 8);
                out.push(mask);
                above.1 = mask;
            }
            let bits = 16 - steps.iter().fold(0, |all, s| all | s).leading_zeros();
            let code = bits.min(15) as u8;
            out[widths + i / 2] |= code << (i % 2 * 4);
            let bits = width_of(code);
            let packed = steps.iter().rev().fold(0u128, |all, s| all << bits | u128::from(*s));
            payload.extend_from_slice(&packed.to_le_bytes()[..bits]);
        }
        out.extend_from_slice(&payload);
    }
}

/// Appends the values that occur, and returns the number of each.
fn pack_values(data: &[u16], none: u16, out: &mut Vec<u8>) -> Option<Table> {
    let mut numbers = table()?;
    for &v in data {
        numbers[usize::from(v)] = 1;
    }
    numbers[usize::from(none)] = 0;
    let count = numbers.iter().map(|&n| u32::from(n)).sum::<u32>();
    out.extend(count.to_le_bytes());
    let (mut next, mut before) = (0u16, 0);
    for (value, number) in numbers.iter_mut().enumerate().filter(|(_, n)| **n == 1) {
        let mut step = value - before;
        while step > 127 {
            out.push(step as u8 | 128);
            step >>= 7;
        }
        out.push(step as u8);
        // At most 65,535 values are numbered: one of all is the value without depth.
        (*number, before) = (next, value);
        next = next.wrapping_add(1);
    }
    Some(numbers)
}

/// The zigzag differences of a block's numbers to those above, which are replaced, and the pixels with depth.
fn differences(pixels: &[u16], none: u16, numbers: &Table, above: &mut [u16; BLOCK]) -> ([u16; BLOCK], u8) {
    let (mut steps, mut mask) = ([0; BLOCK], u8::MAX);
    for (i, &v) in pixels.iter().enumerate() {
        if v == none {
            mask &= !(1 << i);
            continue;
        }
        let number = numbers[usize::from(v)];
        let step = number.wrapping_sub(above[i]);
        steps[i] = (step << 1) ^ ((step as i16) >> 15) as u16;
        above[i] = number;
    }
    (steps, mask)
}

/// Takes bytes off the front.
fn take<'a>(bytes: &mut &'a [u8], count: usize) -> Option<&'a [u8]> {
    let (front, rest) = bytes.split_at_checked(count)?;
    *bytes = rest;
    Some(front)
}

/// Puts the pixels of an image in place of what is there; `None` where the bytes are not one.
pub fn unpack(
    backend: Backend,
    bytes: &[u8],
    width: usize,
    height: usize,
    data: &mut Vec<u16>,
) -> Option<()> {
    let mut rows = Rows::new(bytes, width, height)?;
    data.resize(width.checked_mul(height)?, 0);
    let rows = &mut rows;
    dispatch!(backend, all_rows(rows: &mut Rows, width: usize, data: &mut [u16], backend: Backend) -> Option<()>)
}

#[inline(always)]
fn all_rows(rows: &mut Rows, width: usize, data: &mut [u16], backend: Backend) -> Option<()> {
    for row in data.chunks_exact_mut(width.max(1)) {
        rows.next(backend)?;
        rows.look_up(row, &rows.values, rows.none);
    }
    rows.end()
}

/// Reads a packed image row by row.
pub struct Rows<'a> {
    bytes: &'a [u8],
    /// The value of each number, and how many there are.
    values: Table,
    count: u32,
    none: u16,
    /// The numbers of the row that was read last, and which pixels have depth.
    above: Vec<[u16; BLOCK]>,
    masks: Vec<u8>,
}

impl<'a> Rows<'a> {
    /// Begins an image; `None` where the bytes are not one of this size.
    pub fn new(mut bytes: &'a [u8], width: usize, height: usize) -> Option<Self> {
        let none = u16::from_le_bytes(take(&mut bytes, 2)?.try_into().ok()?);
        let (values, count) = unpack_values(&mut bytes)?;
        let blocks = width.div_ceil(BLOCK);
        // Rows take some bytes even where nothing changes: what is too short is refused before memory is taken.
        if bytes.len() < (blocks.div_ceil(8) + blocks.div_ceil(2)).checked_mul(height)? {
            return None;
        }
        let (above, masks) = (vec![[0; BLOCK]; blocks], vec![u8::MAX; blocks]);
        Some(Self { bytes, values, count, none, above, masks })
    }

    /// The values of pixels with depth, by their numbers.
    pub fn values(&self) -> &[u16] {
        &self.values[..self.count as usize]
    }

    /// Reads the next row; `None` where the bytes are not one.
    #[inline(always)]
    pub fn next(&mut self, backend: Backend) -> Option<()> {
        let blocks = self.above.len();
        let flags = take(&mut self.bytes, blocks.div_ceil(8))?;
        let widths = take(&mut self.bytes, blocks.div_ceil(2))?;
        for (flags, masks) in flags.chunks(8).zip(self.masks.chunks_mut(64)) {
            let mut flags = flags.iter().rev().fold(0u64, |all, byte| all << 8 | u64::from(*byte));
            while flags != 0 {
                if let Some(mask) = masks.get_mut(flags.trailing_zeros() as usize) {
                    *mask = take(&mut self.bytes, 1)?[0];
                }
                flags &= flags - 1;
            }
        }
        let (bytes, above) = (self.bytes, &mut self.above[..]);
        let (taken, largest) = match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::add_row(bytes, widths, above)? },
            _ => add_row(bytes, widths, above)?,
        };
        self.bytes = &self.bytes[taken..];
        (u32::from(largest) < self.count.max(1)).then_some(())
    }

    /// Writes what a table has for the numbers of the row that was read last, and `none` where there is no depth.
    #[inline(always)]
    fn look_up<T: Copy>(&self, row: &mut [T], table: &[T; 1 << 16], none: T) {
        let whole = row.len() / BLOCK * BLOCK;
        let (row, rest) = row.split_at_mut(whole);
        let mut blocks = self.above.iter().zip(&self.masks);
        for (pixels, (numbers, mask)) in row.chunks_exact_mut(BLOCK).zip(blocks.by_ref()) {
            write_block(pixels, numbers, *mask, table, none);
        }
        if let Some((numbers, mask)) = blocks.next() {
            write_block(rest, numbers, *mask, table, none);
        }
    }

    /// [`Self::look_up`] of the pixels of a prepared image.
    #[inline(always)]
    pub fn pixels(&self, backend: Backend, row: &mut [u32], table: &[u32; 1 << 16], none: u32) {
        match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::look_up(row, &self.above, &self.masks, table, none) },
            _ => self.look_up(row, table, none),
        }
    }

    /// `None` where bytes are left behind the last row.
    pub fn end(&self) -> Option<()> {
        self.bytes.is_empty().then_some(())
    }
}

/// The value of each number, and how many there are.
fn unpack_values(bytes: &mut &[u8]) -> Option<(Table, u32)> {
    let count = u32::from_le_bytes(take(bytes, 4)?.try_into().ok()?);
    if count > 1 << 16 {
        return None;
    }
    let mut values = table()?;
    let mut value = 0u16;
    for number in 0..count as usize {
        let (mut step, mut shift) = (0u32, 0);
        loop {
            let byte = take(bytes, 1)?[0];
            step |= u32::from(byte & 127) << shift;
            shift += 7;
            if byte < 128 {
                break;
            }
            if shift > 14 {
                return None;
            }
        }
        value = value.checked_add(u16::try_from(step).ok()?)?;
        values[number] = value;
    }
    Some((values, count))
}

/// Adds a row's differences to the numbers above; returns the bytes that they took and the largest number.
#[inline(always)]
fn add_row(bytes: &[u8], widths: &[u8], above: &mut [[u16; BLOCK]]) -> Option<(usize, u16)> {
    let mut at = 0;
    let mut largest = [0u16; BLOCK];
    for (i, above) in above.iter_mut().enumerate() {
        at += add_block(bytes.get(at..)?, width_of(widths[i / 2] >> (i % 2 * 4) & 15), above)?;
        for (largest, number) in largest.iter_mut().zip(above) {
            *largest = (*largest).max(*number);
        }
    }
    Some((at, largest.into_iter().max()?))
}
