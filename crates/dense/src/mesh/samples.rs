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
}

/// Index of a corner.
pub fn corner_index(corner: [usize; 3]) -> usize {
    corner[0] + CORNERS * (corner[1] + CORNERS * corner[2])
}

/// Which voxels of a block were seen, and which of them lie behind the surface.
struct Rows {
    seen: [u64; SIDE],
    inside: [u64; SIDE],
}

impl Default for Samples {
    fn default() -> Self {
        Self { steps: [0.0; CORNERS * CORNERS * CORNERS], seen: [0; 9], inside: [0; 9], slots: [None; 8] }
    }
}

impl Samples {
    /// Fills in the bits for a block; false when the surface passes through none of its cells.
    pub fn load(&mut self, volume: &TsdfVolume, key: BlockKey, least_weight: i32) -> bool {
        for (i, slot) in self.slots.iter_mut().enumerate() {
            *slot = volume.slot(key.offset([i & 1, i >> 1 & 1, i >> 2].map(|v| v as i32)));
        }
        (self.seen, self.inside) = ([0; CORNERS], [0; CORNERS]);
        let Some(own) = self.slots[0] else { return false };
        let mut rows = Rows { seen: [0; SIDE], inside: [0; SIDE] };
        let (planes, to) = (volume.planes(own), &mut rows);
        dispatch!(Backend::best(), read(planes: &Planes, least_weight: i32, to: &mut Rows) -> ());
        self.copy_own(&rows);
        // A block whose own corners are all of one kind may still have a crossing to the next blocks.
        for i in 1..8 {
            if let Some(slot) = self.slots[i] {
                self.copy_border(volume.planes(slot), [i & 1, i >> 1 & 1, i >> 2], least_weight);
            }
        }
        let live = (0..SIDE).any(|z| self.live_layer(z) != 0);
        if live {
            self.load_steps(volume);
        }
        live
    }

    fn copy_own(&mut self, rows: &Rows) {
        for z in 0..SIDE {
            for y in 0..SIDE {
                self.seen[z] |= u128::from(rows.seen[z] >> (8 * y) & 255) << (CORNERS * y);
                self.inside[z] |= u128::from(rows.inside[z] >> (8 * y) & 255) << (CORNERS * y);
            }
        }
    }

    /// Corners of the face, edge or corner that a next block shares with the cells.
    fn copy_border(&mut self, planes: &Planes, next: [usize; 3], least_weight: i32) {
        let range = |k: usize| if next[k] == 1 { 0..1 } else { 0..SIDE };
        for z in range(2) {
            for y in range(1) {
                for x in range(0) {
                    let i = x + SIDE * (y + SIDE * z);
                    if planes.weight[i] < least_weight {
                        continue;
                    }
                    let at = [x + SIDE * next[0], y + SIDE * next[1], z + SIDE * next[2]];
                    let bit = 1u128 << (at[0] + CORNERS * at[1]);
                    self.seen[at[2]] |= bit;
                    self.inside[at[2]] |= if planes.sum[i] < 0 { bit } else { 0 };
                }
            }
        }
    }

    /// Fills in the distances at all corners.
    fn load_steps(&mut self, volume: &TsdfVolume) {
        let Some(own) = self.slots[0] else { return };
        let (planes, steps) = (volume.planes(own), &mut self.steps);
        dispatch!(Backend::best(), divide(planes: &Planes, steps: &mut [f32; CORNERS * CORNERS * CORNERS]) -> ());
        for i in 1..8 {
            let Some(slot) = self.slots[i] else { continue };
            let (planes, next) = (volume.planes(slot), [i & 1, i >> 1 & 1, i >> 2]);
            let range = |k: usize| if next[k] == 1 { 0..1 } else { 0..SIDE };
            for z in range(2) {
                for y in range(1) {
                    for x in range(0) {
                        let i = x + SIDE * (y + SIDE * z);
                        let at = corner_index([x + SIDE * next[0], y + SIDE * next[1], z + SIDE * next[2]]);
                        self.steps[at] = planes.sum[i] as f32 / planes.weight[i].max(1) as f32;
                    }
                }
            }
        }
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
            let inside = [around(self.inside[z]), around(self.inside[z + 1])];
            let mut live = self.live_layer(z);
            while live != 0 {
                let bit = live.trailing_zeros() as usize;
                let mut case = 0;
                for (i, l) in inside.iter().flatten().enumerate() {
                    case |= ((l >> bit & 1) as usize) << i;
                }
                cell([bit % CORNERS, bit / CORNERS, z], case);
                live &= live - 1;
            }
        }
    }
}

/// A layer of corners, and the same shifted by one along x, along y, and along both.
fn around(l: u128) -> [u128; 4] {
    [l, l >> 1, l >> CORNERS, l >> (CORNERS + 1)]
}

/// Distances of a block's own voxels.
#[inline(always)]
fn divide(planes: &Planes, steps: &mut [f32; CORNERS * CORNERS * CORNERS]) {
    for row in 0..SIDE * SIDE {
        let from = row * SIDE;
        let to = CORNERS * (row % SIDE + CORNERS * (row / SIDE));
        let (sum, weight) = (&planes.sum[from..from + SIDE], &planes.weight[from..from + SIDE]);
        for ((out, &s), &w) in steps[to..to + SIDE].iter_mut().zip(sum).zip(weight) {
            *out = s as f32 / w.max(1) as f32;
        }
    }
}

#[inline(always)]
fn read(planes: &Planes, least_weight: i32, out: &mut Rows) {
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
