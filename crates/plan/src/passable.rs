//! Which cells may be entered, one bit each: stored by rows for scans along x, and by columns for scans along y.
//!
//! Each line is padded by 64 blocked bits before and at least 64 after it, and there is a blocked line before the first
//! and after the last, so that a search never needs to check whether a neighbour is inside. A window of 57 bits is one
//! load.

use crate::grid::{Cell, Grid, GridFrame};

/// Blocked bits before the first cell of a line.
const PAD: usize = 64;
/// Number of valid bits in a window, counted from its first.
pub(crate) const WINDOW: usize = 57;

/// The bits of all lines: rows or columns.
#[derive(Clone, Debug)]
pub(crate) struct Lines {
    bytes: Vec<u8>,
    stride: usize,
}

impl Lines {
    fn new(lines: usize, length: usize) -> Self {
        // The last byte of a line is followed by eight of padding.
        let stride = PAD / 8 + length.div_ceil(8) + 8;
        // Eight more, so that a window may begin at the very last byte.
        Self { bytes: vec![0; stride * (lines + 2) + 8], stride }
    }

    /// Bits of line `line` (from -1 to one past the last) from position `at` (from -64) on; the first 57 are valid.
    #[inline(always)]
    pub(crate) fn window(&self, line: i32, at: i32) -> u64 {
        let bit = (at + PAD as i32) as usize;
        let byte = (line + 1) as usize * self.stride + bit / 8;
        match self.bytes.get(byte..).and_then(|rest| rest.first_chunk::<8>()) {
            Some(chunk) => u64::from_le_bytes(*chunk) >> (bit % 8),
            None => 0,
        }
    }

    fn set(&mut self, line: usize, at: usize, value: bool) {
        let bit = at + PAD;
        let byte = &mut self.bytes[(line + 1) * self.stride + bit / 8];
        *byte = *byte & !(1 << (bit % 8)) | u8::from(value) << (bit % 8);
    }

    /// The bytes of a line from its first cell on.
    fn line_mut(&mut self, line: usize) -> &mut [u8] {
        let from = (line + 1) * self.stride + PAD / 8;
        &mut self.bytes[from..from + self.stride - PAD / 8]
    }
}

/// Which cells of a grid may be entered.
#[derive(Clone, Debug)]
pub struct Passable {
    frame: GridFrame,
    pub(crate) rows: Lines,
    pub(crate) columns: Lines,
    free: usize,
}

impl Passable {
    /// From a grid that is true where a cell may be entered.
    pub fn new(free: &Grid<bool>) -> Self {
        Self::from_values(free, |v| v)
    }

    /// From a grid of values, by a rule that says which of them are passable.
    pub fn from_values<T: Copy>(grid: &Grid<T>, passable: impl Fn(T) -> bool) -> Self {
        let frame = *grid.frame();
        let (width, height) = (frame.width(), frame.height());
        let mut rows = Lines::new(height, width);
        let mut columns = Lines::new(width, height);
        let mut free = 0;
        for y in 0..height {
            for (cells, byte) in grid.row(y).chunks(8).zip(rows.line_mut(y)) {
                *byte = packed(cells, &passable);
                free += byte.count_ones() as usize;
            }
        }
        for y in (0..height).step_by(8) {
            for byte in 0..width.div_ceil(8) {
                let at = |k: usize| rows.bytes[(y + k + 1) * rows.stride + PAD / 8 + byte];
                let block = (0..8.min(height - y)).fold(0u64, |b, k| b | u64::from(at(k)) << (8 * k));
                let turned = transpose(block);
                for k in 0..8.min(width - byte * 8) {
                    columns.line_mut(byte * 8 + k)[y / 8] = (turned >> (8 * k)) as u8;
                }
            }
        }
        Self { frame, rows, columns, free }
    }

    /// Size, resolution and pose of the grid.
    pub fn frame(&self) -> &GridFrame {
        &self.frame
    }

    /// Number of cells that may be entered.
    pub fn free(&self) -> usize {
        self.free
    }

    /// Whether a cell may be entered; false outside.
    pub fn is_free(&self, cell: Cell) -> bool {
        self.frame.contains(cell) && self.at(cell.x as i32, cell.y as i32)
    }

    /// Opens or closes a cell; returns whether that changed it (never outside).
    pub fn set(&mut self, cell: Cell, free: bool) -> bool {
        if !self.frame.contains(cell) || self.is_free(cell) == free {
            return false;
        }
        let (x, y) = (cell.x as usize, cell.y as usize);
        self.rows.set(y, x, free);
        self.columns.set(x, y, free);
        self.free = if free { self.free + 1 } else { self.free - 1 };
        true
    }

    /// Whether the cell may be entered; positions up to one cell outside the grid are allowed.
    #[inline(always)]
    pub(crate) fn at(&self, x: i32, y: i32) -> bool {
        self.rows.window(y, x) & 1 != 0
    }

    /// The eight neighbours of a cell as bits: 0 = east, then counter-clockwise (y grows northwards).
    #[inline(always)]
    pub(crate) fn neighbours(&self, x: i32, y: i32) -> u8 {
        let below = self.rows.window(y - 1, x - 1) as u32 & 7;
        let here = self.rows.window(y, x - 1) as u32 & 7;
        let above = self.rows.window(y + 1, x - 1) as u32 & 7;
        let bits = (here >> 2)
            | (above >> 1 & 2)
            | (above << 1 & 4)
            | (above << 3 & 8)
            | (here << 4 & 16)
            | (below << 5);
        bits as u8
    }
}

/// One bit for each of up to eight values.
#[inline(always)]
fn packed<T: Copy>(cells: &[T], passable: &impl Fn(T) -> bool) -> u8 {
    let mut flags = [0u8; 8];
    flags.iter_mut().zip(cells).for_each(|(flag, &v)| *flag = u8::from(passable(v)));
    // Each byte is 0 or 1; the product gathers them in the top byte without carries.
    (u64::from_le_bytes(flags).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
}

/// Transposes an 8 x 8 block of bits (Warren, Hacker's Delight, 7-3).
fn transpose(mut x: u64) -> u64 {
    let mut swap = |shift: u32, mask: u64| {
        let t = (x ^ (x >> shift)) & mask;
        x ^= t ^ (t << shift);
    };
    swap(7, 0x00AA_00AA_00AA_00AA);
    swap(14, 0x0000_CCCC_0000_CCCC);
    swap(28, 0x0000_0000_F0F0_F0F0);
    x
}
