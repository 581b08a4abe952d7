//! Sets of corners, cells or edges of a block, as bits.
//!
//! A corner's number is `x | y << 4 | z << 8`; a cell and an edge are numbered by their lowest corner. Bits are kept in rows
//! along x, sixteen rows a layer, so that the bits of a set, one after the other, are the numbers of what is in it.

use crate::block::SIDE;

/// Corners along an edge of the block's grid of cells.
pub const CORNERS: usize = SIDE + 1;
/// Rows of a layer.
pub const LAYER: usize = 16;
/// From a corner to the next along each axis.
pub const STRIDES: [usize; 3] = [1, LAYER, LAYER * LAYER];
/// More than the number of any corner, a power of two.
pub const NUMBERS: usize = LAYER * LAYER * LAYER;
/// More than the number of any cell.
pub const CELL_NUMBERS: usize = LAYER * LAYER * SIDE;

/// Number of a corner.
pub fn corner_number(corner: [usize; 3]) -> usize {
    corner[0] * STRIDES[0] + corner[1] * STRIDES[1] + corner[2] * STRIDES[2]
}

/// The corner with a number.
#[inline(always)]
pub fn corner_of(number: usize) -> [usize; 3] {
    [number & 15, number >> 4 & 15, number >> 8]
}

/// A bit for each cell of a block, or for each voxel, by layers; `x | y << 3` has the bit of that number.
pub type Layers = [u64; SIDE];

/// The first of each two rows that are together, of which one is in a set.
#[inline(always)]
pub fn pairs(rows: u64) -> u64 {
    (rows | rows >> 1) & 0x5555_5555_5555_5555
}

/// The row of corners that a block's row is (row y of layer z by `y | z << 3`), where the block is the next along y (2) or z (4) or both.
#[inline(always)]
pub fn row_in(block: usize, row: usize) -> usize {
    let (y, z) = (row % SIDE + SIDE * (block >> 1 & 1), row / SIDE + SIDE * (block >> 2));
    y + LAYER * z
}

/// A set of corners, cells or edges, four rows a word. There are words of nothing before the first and behind the last, so that those
/// around a word can be read without looking where it lies.
#[derive(Clone, Copy)]
pub struct Rows([u64; LEAD + WORDS + LEAD]);

/// Words of all rows, those of a layer, and those before the first.
pub const WORDS: usize = CORNERS * LAYER / 4;
pub const LAYER_WORDS: usize = LAYER / 4;
const LEAD: usize = LAYER_WORDS + 1;

impl Rows {
    pub const EMPTY: Self = Self([0; LEAD + WORDS + LEAD]);

    /// The rows of a word.
    #[inline(always)]
    pub fn at(&self, word: usize) -> u64 {
        self.0[LEAD + word]
    }

    /// The rows of a word, to be changed.
    #[inline(always)]
    pub fn at_mut(&mut self, word: usize) -> &mut u64 {
        &mut self.0[LEAD + word]
    }

    /// Takes all members out.
    #[inline(always)]
    pub fn clear(&mut self) {
        self.0[LEAD..LEAD + WORDS].fill(0);
    }

    /// The rows of a layer, to be changed.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn layer_mut(&mut self, z: usize) -> &mut [u64] {
        &mut self.0[LEAD + LAYER_WORDS * z..][..LAYER_WORDS]
    }

    /// For each corner the next along y; the next along z; the next along both.
    #[inline(always)]
    pub fn next(&self, word: usize) -> [u64; 3] {
        let along_y = |word: usize| self.0[word] >> 16 | self.0[word + 1] << 48;
        [along_y(LEAD + word), self.0[LEAD + LAYER_WORDS + word], along_y(LEAD + LAYER_WORDS + word)]
    }

    /// For each corner the one before along y; the one before along z; the one before along both.
    #[inline(always)]
    pub fn before(&self, word: usize) -> [u64; 3] {
        let along_y = |word: usize| self.0[word] << 16 | self.0[word - 1] >> 48;
        [along_y(LEAD + word), self.0[word + LEAD - LAYER_WORDS], along_y(word + LEAD - LAYER_WORDS)]
    }

    /// One row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> usize {
        (self.0[LEAD + row / 4] >> (row % 4 * 16) & 0xffff) as usize
    }

    /// All words, eight at a time, with words of nothing behind the last.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    pub fn eights(&self) -> impl Iterator<Item = &[u64; 8]> {
        self.0[LEAD..].as_chunks().0.iter()
    }

    /// The words that have members, one bit each.
    #[inline(always)]
    pub fn words(&self) -> u64 {
        let mut out = 0;
        for word in 0..WORDS {
            out |= u64::from(self.at(word) != 0) << word;
        }
        out
    }

    /// Lists the places of the members behind the first `count` of a list, and returns how many it has then.
    #[inline(always)]
    pub fn list(&self, axis: usize, out: &mut List, mut count: usize) -> usize {
        let mut words = self.words();
        while words != 0 {
            let word = words.trailing_zeros() as usize;
            words &= words - 1;
            let mut rest = self.at(word % WORDS);
            while rest != 0 {
                out[count % MOST] = (4 * (64 * word + rest.trailing_zeros() as usize) + axis) as u32;
                rest &= rest - 1;
                count += 1;
            }
        }
        count
    }
}

/// More than the cells of a block, and than its edges along all axes, with room behind the last for those who write several at a time; a
/// power of two.
pub const MOST: usize = 2048;
const _: () = assert!(3 * SIDE * CORNERS * CORNERS + 64 < MOST);

/// Places of cells or edges: four times the number, plus the axis of an edge.
pub type List = [u32; MOST];

/// More than any place, a power of two.
pub const PLACES: usize = 4 * NUMBERS;
// Two corners each are read beside, above and behind the last cell.
const _: () = assert!(4 * (CELL_NUMBERS + LAYER * LAYER + LAYER + 2) < PLACES);
