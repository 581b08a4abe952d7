//! Which cells of a block the surface passes through, from the bits of the block and of those that come next along the axes.

#[cfg(target_arch = "x86_64")]
use super::kernel_x86;
use super::rows::{Layers, pairs};
use crate::Backend;
use crate::backend::dispatch;
use crate::block::SIDE;
use crate::grid::NO_SLOT;
use crate::tsdf::{Bits, TsdfVolume};

/// The voxels of a block that does not exist.
const EMPTY: Bits = Bits { seen: [0; SIDE], inside: [0; SIDE] };

/// A block with cells that the surface passes through.
#[derive(Clone, Copy)]
pub struct Live {
    /// Slots of the eight blocks that the corners of its cells come from, see [`BlockGrid::around`].
    ///
    /// [`BlockGrid::around`]: crate::grid::BlockGrid::around
    pub slots: [u32; 8],
    /// Cells with all corners seen, some inside and some outside.
    pub cells: Layers,
    /// The rows along x of each of these blocks that have corners of such cells: row y of layer z has the bit of `y | z << 3`.
    pub rows: [u64; 8],
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
        let rows = match backend {
            #[cfg(target_arch = "x86_64")]
            #[allow(unsafe_code)]
            // SAFETY: a backend is only chosen when the processor has its instructions.
            Backend::Avx512 => unsafe { kernel_x86::live(bits, out) },
            _ => dispatch!(backend, live(bits: &[&Bits; 8], out: &mut Layers) -> [u64; 2]),
        };
        (rows[0] != 0).then(|| {
            let [[own, y, z, both], [x, x_y, x_z, all]] = rows.map(rows_around);
            let live = Self { slots, cells, rows: [own, x, y, x_y, z, x_z, both, all] };
            live.fetch(volume);
            live
        })
    }

    /// Asks for the distances and weights at the corners of the cells.
    fn fetch(&self, volume: &TsdfVolume) {
        for (&rows, &slot) in self.rows.iter().zip(&self.slots) {
            if rows == 0 || slot == NO_SLOT {
                continue;
            }
            let (planes, mut pairs) = (volume.planes(slot), pairs(rows));
            while pairs != 0 {
                planes.fetch(SIDE * pairs.trailing_zeros() as usize);
                pairs &= pairs - 1;
            }
        }
    }
}

/// The rows that have corners of cells, by the rows of these: in their block, in the next along y, along z, and along both.
fn rows_around(cells: u64) -> [u64; 4] {
    const FIRST: u64 = 0x0101_0101_0101_0101;
    let (own, y) = (cells | cells << 1 & !FIRST, cells >> 7 & FIRST);
    [own | own << 8, y | y << 8, own >> 56, y >> 56]
}

/// Finds the cells; returns the rows along x that have some, and those of which the last is one: row y of layer z has the bit of
/// `y | z << 3`.
#[inline(always)]
fn live(bits: &[&Bits; 8], out: &mut Layers) -> [u64; 2] {
    // Most blocks lie in front of the surface: nothing of them is behind it.
    if bits.iter().flat_map(|b| &b.inside).fold(0, |any, layer| any | layer) == 0 {
        return [0; 2];
    }
    let all_seen = corners(|block| &bits[block].seen, |a, b| a & b);
    let all_inside = corners(|block| &bits[block].inside, |a, b| a & b);
    let any_inside = corners(|block| &bits[block].inside, |a, b| a | b);
    let mut rows = [0; 2];
    for z in 0..SIDE {
        out[z] = all_seen[z] & any_inside[z] & !all_inside[z];
        rows[0] |= rows_with(out[z]) << (SIDE * z);
        rows[1] |= rows_with(out[z] & 0x8080_8080_8080_8080) << (SIDE * z);
    }
    rows
}

/// The rows of a layer that have a bit: row y as bit y.
#[inline(always)]
fn rows_with(layer: u64) -> u64 {
    let halves = layer | layer >> 4;
    let quarters = halves | halves >> 2;
    let any = (quarters | quarters >> 1) & 0x0101_0101_0101_0101;
    any.wrapping_mul(0x0102_0408_1020_4080) >> 56
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
