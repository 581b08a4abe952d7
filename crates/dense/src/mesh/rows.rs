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

    /// The words that have members, one bit each.
    #[inline(always)]
    fn words(&self) -> u64 {
        let mut out = 0;
        for word in 0..WORDS {
            out |= u64::from(self.at(word) != 0) << word;
        }
        out
    }

    /// Lists the numbers of the members, and returns how many there are.
    #[inline(always)]
    pub fn list(&self, out: &mut List) -> usize {
        let (mut count, mut words) = (0, self.words());
        while words != 0 {
            let word = words.trailing_zeros() as usize % WORDS;
            words &= words - 1;
            let mut rest = self.at(word);
            let end = count + rest.count_ones() as usize;
            // Eight at a time, whether there are so many or not: to look would take longer.
            while count < end {
                for number in &mut out[count..count + 8] {
                    *number = (64 * word + rest.trailing_zeros() as usize) as u16;
                    rest &= rest.wrapping_sub(1);
                }
                count += 8;
            }
            count = end;
        }
        count
    }
}

/// More than the cells of a block, or its edges along an axis: loops over several at a time may go past the last.
pub const MOST: usize = SIDE * CORNERS * CORNERS + 16;

/// Numbers of corners, cells or edges.
pub type List = [u16; MOST];
