//! Which cells of a block the surface passes through, from the bits of the block and of those that come next along the axes.

use super::rows::CORNERS;
use crate::Backend;
use crate::backend::dispatch;
use crate::block::SIDE;
use crate::grid::NO_SLOT;
use crate::tsdf::{Bits, TsdfVolume};

/// The voxels of a block that does not exist.
const EMPTY: Bits = Bits { seen: [0; SIDE], inside: [0; SIDE] };

/// A bit for each cell of a block, or for each voxel, by layers; `x | y << 3` has the bit of that number.
pub type Layers = [u64; SIDE];

/// A block with cells that the surface passes through.
#[derive(Clone, Copy)]
pub struct Live {
    /// Slots of the eight blocks that the corners of its cells come from, see [`BlockGrid::around`].
    ///
    /// [`BlockGrid::around`]: crate::grid::BlockGrid::around
    pub slots: [u32; 8],
    /// Cells with all corners seen, some inside and some outside.
    pub cells: Layers,
    /// By layer of corners the rows along x that have corners of these cells, row y as bit y; and those of which that is so of the last
    /// corner, in the next block.
    pub rows: [[u32; CORNERS]; 2],
}

/// Bits of the eight blocks around a block's cells.
#[inline(always)]
pub fn bits(volume: &TsdfVolume, slots: [u32; 8]) -> [&Bits; 8] {
    let mut bits = [&EMPTY; 8];
    for (bits, slot) in bits.iter_mut().zip(slots) {
        if slot != NO_SLOT {
            *bits = volume.bits(slot);
        }
    }
    bits
}

impl Live {
    /// Looks for such cells in a block; `None` where there are none. What is needed to mesh it is asked for, so that it is near when
    /// another block has been meshed in the meantime.
    pub fn find(volume: &TsdfVolume, slots: [u32; 8], backend: Backend) -> Option<Self> {
        if slots[0] == NO_SLOT {
            return None;
        }
        let (bits, mut cells) = (&bits(volume, slots), [0; SIDE]);
        let out = &mut cells;
        let any = dispatch!(backend, live(bits: &[&Bits; 8], out: &mut Layers) -> bool);
        any.then(|| {
            let rows = [rows_around(&cells, u64::MAX), rows_around(&cells, 0x8080_8080_8080_8080)];
            let live = Self { slots, cells, rows };
            live.fetch(volume);
            live
        })
    }

    /// Asks for the distances and weights at the corners of the cells.
    fn fetch(&self, volume: &TsdfVolume) {
        for (next, rows) in self.rows.iter().enumerate() {
            for (z, rows) in rows.iter().enumerate() {
                // Two rows are together.
                let mut pairs = (rows | rows >> 1) & 0x155;
                while pairs != 0 {
                    let y = pairs.trailing_zeros() as usize;
                    pairs &= pairs - 1;
                    let (block, from) = source(y, z);
                    let slot = self.slots[block | next];
                    if slot != NO_SLOT {
                        volume.planes(slot).fetch(from);
                    }
                }
            }
        }
    }
}

/// The block that a row of corners comes from, and its first voxel there.
#[inline(always)]
pub fn source(y: usize, z: usize) -> (usize, usize) {
    ((y / SIDE) << 1 | (z / SIDE) << 2, SIDE * (y % SIDE + SIDE * (z % SIDE)))
}

/// The rows of corners of some of a block's cells, by layer.
fn rows_around(cells: &Layers, of: u64) -> [u32; CORNERS] {
    let mut rows = [0; CORNERS];
    for (z, layer) in cells.iter().enumerate() {
        let own = rows_with(layer & of);
        rows[z] |= own | own << 1;
        rows[z + 1] |= own | own << 1;
    }
    rows
}

/// The rows of a layer that have a bit: row y as bit y.
fn rows_with(layer: u64) -> u32 {
    let halves = layer | layer >> 4;
    let quarters = halves | halves >> 2;
    let any = (quarters | quarters >> 1) & 0x0101_0101_0101_0101;
    (any.wrapping_mul(0x0102_0408_1020_4080) >> 56) as u32
}

#[inline(always)]
fn live(bits: &[&Bits; 8], out: &mut Layers) -> bool {
    // Most blocks lie in front of the surface: nothing of them is behind it.
    if bits.iter().flat_map(|b| &b.inside).fold(0, |any, layer| any | layer) == 0 {
        return false;
    }
    let all_seen = corners(|block| &bits[block].seen, |a, b| a & b);
    let all_inside = corners(|block| &bits[block].inside, |a, b| a & b);
    let any_inside = corners(|block| &bits[block].inside, |a, b| a | b);
    let mut any = 0;
    for z in 0..SIDE {
        out[z] = all_seen[z] & any_inside[z] & !all_inside[z];
        any |= out[z];
    }
    any != 0
}

/// For each cell what joins the bits of its eight corners.
#[inline(always)]
fn corners<'a>(layers: impl Fn(usize) -> &'a Layers, join: impl Fn(u64, u64) -> u64 + Copy) -> Layers {
    let mut columns = [[0; SIDE]; 4];
    for (i, out) in columns.iter_mut().enumerate() {
        let (own, next) = (layers(i), layers(i | 4));
        for z in 0..SIDE {
            out[z] = join(own[z], if z + 1 < SIDE { own[z + 1] } else { next[0] });
        }
    }
    let along_x = |own: u64, next: u64| {
        let after = own >> 1 & 0x7f7f_7f7f_7f7f_7f7f | next << 7 & 0x8080_8080_8080_8080;
        join(own, after)
    };
    let mut out = [0; SIDE];
    for z in 0..SIDE {
        let near = along_x(columns[0][z], columns[1][z]);
        let far = along_x(columns[2][z], columns[3][z]);
        out[z] = join(near, near >> 8 | far << 56);
    }
    out
}
