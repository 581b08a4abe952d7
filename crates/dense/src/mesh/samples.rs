//! The 9x9x9 corners of a block's cells as bits, and which cells the surface passes through.

use crate::Backend;
use crate::backend::dispatch;
use crate::block::{BlockKey, SIDE};
use crate::tsdf::{Planes, STEPS, TsdfVolume};

/// Corners along an edge of the block's grid of cells.
pub const CORNERS: usize = SIDE + 1;

/// Corners of a block's cells, including those that belong to the next blocks; x varies fastest, then y, then z.
#[derive(Clone)]
pub struct Samples {
    /// Distance in steps; meaningless where nothing was seen.
    pub steps: [f32; CORNERS * CORNERS * CORNERS],
    /// Per layer, one bit a corner (`x + 9 * y`): seen often enough.
    seen: [u128; CORNERS],
    /// Per layer: seen, and behind the surface.
    inside: [u128; CORNERS],
    /// Slots of the eight blocks that the corners come from: bit 0 of the index selects the next one along x, and so
    /// on.
    pub slots: [Option<u32>; 8],
    met: Met,
}

/// Index of a corner.
pub fn corner_index(corner: [usize; 3]) -> usize {
    corner[0] + CORNERS * (corner[1] + CORNERS * corner[2])
}

/// Which voxels of a block were seen, and which of them lie behind the surface: one bit a voxel, by layers.
#[derive(Clone, Copy, Default)]
struct Bits {
    seen: [u64; SIDE],
    inside: [u64; SIDE],
}

/// The bits of the blocks that a call has met: a block is asked for by itself and by its neighbours.
#[derive(Clone, Default)]
struct Met {
    /// By slot: the call that the bits are of.
    bits: Vec<(u32, Bits)>,
    call: u32,
}

impl Default for Samples {
    fn default() -> Self {
        Self {
            steps: [0.0; CORNERS * CORNERS * CORNERS],
            seen: [0; CORNERS],
            inside: [0; CORNERS],
            slots: [None; 8],
            met: Met::default(),
        }
    }
}

impl Met {
    fn of(&mut self, volume: &TsdfVolume, slot: u32, least_weight: i32) -> Bits {
        let at = slot as usize;
        if self.bits.len() <= at {
            self.bits.resize(at + 1, (0, Bits::default()));
        }
        let (call, bits) = &mut self.bits[at];
        if *call != self.call {
            let planes = volume.planes(slot);
            dispatch!(Backend::best(), read(planes: &Planes, least_weight: i32, bits: &mut Bits) -> ());
            *call = self.call;
        }
        *bits
    }
}

impl Samples {
    /// Forgets what it has read: the field may have changed, or be another one.
    pub fn begin(&mut self) {
        if self.met.call == u32::MAX {
            self.met = Met::default();
        }
        self.met.call += 1;
    }

    /// Fills in the bits for a block; false when the surface passes through none of its cells.
    pub fn load(&mut self, volume: &TsdfVolume, key: BlockKey, least_weight: i32) -> bool {
        let Some(own) = volume.slot(key) else { return false };
        self.slots[0] = Some(own);
        for i in 1..8 {
            self.slots[i] = volume.slot(key.offset([i & 1, i >> 1 & 1, i >> 2].map(|v| v as i32)));
        }
        let bits =
            self.slots.map(|slot| slot.map_or(Bits::default(), |s| self.met.of(volume, s, least_weight)));
        // Most blocks lie in front of the surface: nothing of them is behind it.
        let inside = bits.iter().flat_map(|b| &b.inside).fold(0, |any, layer| any | layer);
        if inside == 0 {
            return false;
        }
        let layer = |of: [u64; 4]| widened(of);
        for z in 0..SIDE {
            self.seen[z] = layer([0, 1, 2, 3].map(|i| bits[i].seen[z]));
            self.inside[z] = layer([0, 1, 2, 3].map(|i| bits[i].inside[z]));
        }
        self.seen[SIDE] = layer([4, 5, 6, 7].map(|i| bits[i].seen[0]));
        self.inside[SIDE] = layer([4, 5, 6, 7].map(|i| bits[i].inside[0]));
        let live = (0..SIDE).any(|z| self.live_layer(z) != 0);
        if live {
            self.load_steps(volume);
        }
        live
    }

    /// Fills in the distances at all corners.
    fn load_steps(&mut self, volume: &TsdfVolume) {
        let planes = self.slots.map(|slot| slot.map(|s| volume.planes(s)));
        let (planes, steps) = (&planes, &mut self.steps);
        dispatch!(Backend::best(), divide(
            planes: &[Option<&Planes>; 8], steps: &mut [f32; CORNERS * CORNERS * CORNERS]
        ) -> ());
    }

    /// The cells of a layer that the surface passes through: all corners seen, some inside and some outside.
    fn live_layer(&self, z: usize) -> u128 {
        // Only lower corners of cells: not the last of a row, nor the last row.
        const CELLS: u128 = {
            let (mut cells, mut y) = (0, 0);
            while y < SIDE {
                cells |= 255 << (CORNERS * y);
                y += 1;
            }
            cells
        };
        let all =
            |l: &[u128; CORNERS]| around(l[z]).iter().chain(&around(l[z + 1])).fold(u128::MAX, |m, l| m & l);
        let any = around(self.inside[z]).iter().chain(&around(self.inside[z + 1])).fold(0, |m, l| m | l);
        CELLS & all(&self.seen) & any & !all(&self.inside)
    }

    /// Calls the closure with each cell that the surface passes through, and the set of its inside corners.
    pub fn live_cells(&self, mut cell: impl FnMut([usize; 3], usize)) {
        for z in 0..SIDE {
            let live = self.live_layer(z);
            if live == 0 {
                continue;
            }
            for y in 0..SIDE {
                let row = |layer: u128, y: usize| (layer >> (CORNERS * y)) as u32;
                let mut live = row(live, y) & 255;
                let [low, high] = [self.inside[z], self.inside[z + 1]];
                let rows = [row(low, y), row(low, y + 1), row(high, y), row(high, y + 1)];
                while live != 0 {
                    let x = live.trailing_zeros();
                    let pair = |i: usize| (rows[i] >> x & 3) << (2 * i);
                    cell([x as usize, y, z], (pair(0) | pair(1) | pair(2) | pair(3)) as usize);
                    live &= live - 1;
                }
            }
        }
    }
}

/// A layer of corners, and the same shifted by one along x, along y, and along both.
fn around(l: u128) -> [u128; 4] {
    [l, l >> 1, l >> CORNERS, l >> (CORNERS + 1)]
}

/// A layer of 9x9 corners from 8x8 of the block, the first column of the next along x, the first row of the next along y, and
/// the first of the one along both.
fn widened([own, x, y, both]: [u64; 4]) -> u128 {
    let mut out = u128::from(y & 255 | (both & 1) << 8) << (CORNERS * SIDE);
    for row in 0..SIDE {
        let corners = own >> (8 * row) & 255 | (x >> (8 * row) & 1) << 8;
        out |= u128::from(corners) << (CORNERS * row);
    }
    out
}

/// Distances at the corners, row by row: eight of a block and the first of the next along x.
#[inline(always)]
fn divide(planes: &[Option<&Planes>; 8], steps: &mut [f32; CORNERS * CORNERS * CORNERS]) {
    for z in 0..CORNERS {
        for y in 0..CORNERS {
            let next = (y / SIDE) << 1 | (z / SIDE) << 2;
            let from = SIDE * (y % SIDE + SIDE * (z % SIDE));
            let to = CORNERS * (y + CORNERS * z);
            if let Some(planes) = planes[next] {
                let (sum, weight) = (&planes.sum[from..from + SIDE], &planes.weight[from..from + SIDE]);
                for ((out, &s), &w) in steps[to..to + SIDE].iter_mut().zip(sum).zip(weight) {
                    *out = s as f32 / w.max(1) as f32;
                }
            }
            if let Some(planes) = planes[next | 1] {
                steps[to + SIDE] = planes.sum[from] as f32 / planes.weight[from].max(1) as f32;
            }
        }
    }
}

#[inline(always)]
fn read(planes: &Planes, least_weight: i32, out: &mut Bits) {
    for z in 0..SIDE {
        let sum = &planes.sum[64 * z..64 * z + 64];
        let weight = &planes.weight[64 * z..64 * z + 64];
        let (mut seen, mut inside) = (0, 0);
        for i in 0..64 {
            let is_seen = weight[i] >= least_weight;
            seen |= u64::from(is_seen) << i;
            inside |= u64::from(is_seen & (sum[i] < 0)) << i;
        }
        (out.seen[z], out.inside[z]) = (seen, inside);
    }
}

/// Neighbouring distances that differ by more than this belong to two surfaces, one behind the other: there is no
/// surface between them.
pub const JUMP: f32 = 1.25 * STEPS as f32;
