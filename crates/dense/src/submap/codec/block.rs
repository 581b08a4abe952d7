//! One block of eight pixels of a packed image, see [`super::blocks`].

/// Pixels of a block.
pub const BLOCK: usize = 8;
/// Bytes that a block takes at most.
pub const MOST_BYTES: usize = 16;
/// Bits of a difference by the code of its block.
pub const fn width_of(code: u8) -> usize {
    code as usize + (code == 15) as usize
}

/// The bytes of a block from a place on, with whatever or nothing behind them; `None` where they are not there.
#[inline(always)]
pub fn block_at(bytes: &[u8], at: usize, bits: usize) -> Option<[u8; MOST_BYTES]> {
    if let Some(whole) = bytes.get(at..at + MOST_BYTES) {
        return whole.try_into().ok();
    }
    let mut padded = [0; MOST_BYTES];
    let rest = bytes.get(at..).filter(|rest| rest.len() >= bits)?;
    padded[..rest.len()].copy_from_slice(rest);
    Some(padded)
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
