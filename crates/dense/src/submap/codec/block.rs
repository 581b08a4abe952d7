//! One block of eight pixels of a packed image, see [`super::blocks`].

/// Pixels of a block.
pub const BLOCK: usize = 8;
/// Bytes that a block takes at most.
const MOST_BYTES: usize = 16;
/// Bits of a difference by the code of its block.
pub const fn width_of(code: u8) -> usize {
    code as usize + (code == 15) as usize
}

/// The bytes of a block, with whatever or nothing behind them; `None` where they are not there.
#[inline(always)]
fn block_at(bytes: &[u8], bits: usize) -> Option<[u8; MOST_BYTES]> {
    if let Some(whole) = bytes.first_chunk() {
        return Some(*whole);
    }
    let mut padded = [0; MOST_BYTES];
    if bytes.len() < bits {
        return None;
    }
    padded[..bytes.len()].copy_from_slice(bytes);
    Some(padded)
}

/// Adds the differences of a block of so many bits to the numbers above; returns its bytes.
#[inline(always)]
pub fn add_block(bytes: &[u8], bits: usize, above: &mut [u16; BLOCK]) -> Option<usize> {
    let packed = u128::from_le_bytes(block_at(bytes, bits)?);
    let mask = (1u64 << bits) - 1;
    let halves = [packed as u64, (packed >> (4 * bits)) as u64];
    for k in 0..BLOCK {
        let step = (halves[k / 4] >> (k % 4 * bits) & mask) as u16;
        above[k] = above[k].wrapping_add((step >> 1) ^ (step & 1).wrapping_neg());
    }
    Some(bits)
}

/// Writes what a table has for the numbers of a block, and `none` where the mask has no bit.
#[inline(always)]
pub fn write_block<T: Copy>(
    pixels: &mut [T],
    numbers: &[u16; BLOCK],
    mask: u8,
    table: &[T; 1 << 16],
    none: T,
) {
    if mask == 0 {
        pixels.fill(none);
        return;
    }
    for (pixel, number) in pixels.iter_mut().zip(numbers) {
        *pixel = table[usize::from(*number)];
    }
    // Few blocks lie on the edge of a hole.
    let mut holes = !mask;
    while holes != 0 {
        if let Some(pixel) = pixels.get_mut(holes.trailing_zeros() as usize) {
            *pixel = none;
        }
        holes &= holes - 1;
    }
}
