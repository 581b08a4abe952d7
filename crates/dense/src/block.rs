//! Blocks of 8x8x8 voxels: their keys, the table from key to slot, and paged memory for them.

use cairn_geometry::Vec3;
use std::collections::HashMap;
use std::hash::{BuildHasherDefault, Hasher};

/// Voxels along an edge of a block.
pub const SIDE: usize = 8;
/// Voxels of a block.
pub const VOXELS: usize = SIDE * SIDE * SIDE;
/// Limit of the absolute value of a key's coordinates: no real submap is larger, and `f32` positions stay exact.
pub const KEY_LIMIT: i32 = 1 << 20;

/// Position of a block: its lowest corner is at `8 * voxel * key`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BlockKey(pub [i32; 3]);

impl BlockKey {
    /// The key of the block offset by this many blocks along each axis.
    pub fn offset(self, by: [i32; 3]) -> Self {
        Self(std::array::from_fn(|i| self.0[i] + by[i]))
    }

    /// The block that holds a voxel, and the voxel's index in it.
    pub fn of_voxel(voxel: [i32; 3]) -> (Self, usize) {
        let local = voxel.map(|v| (v & 7) as usize);
        (Self(voxel.map(|v| v >> 3)), index(local))
    }

    /// The lowest corner in metres.
    pub fn corner_m(self, voxel_m: f64) -> Vec3 {
        Vec3::new(f64::from(self.0[0]), f64::from(self.0[1]), f64::from(self.0[2])) * (SIDE as f64 * voxel_m)
    }
}

/// Index of a voxel inside its block: x varies fastest, then y, then z.
pub fn index(local: [usize; 3]) -> usize {
    local[0] + SIDE * (local[1] + SIDE * local[2])
}

/// Hash of the three coordinates of a key; keys come from geometry, so no protection from an adversary is needed.
#[derive(Default)]
pub struct KeyHasher(u64);

impl Hasher for KeyHasher {
    fn finish(&self) -> u64 {
        self.0 ^ (self.0 >> 29)
    }
    fn write(&mut self, bytes: &[u8]) {
        // Arrays of coordinates are hashed as bytes.
        for chunk in bytes.chunks(4) {
            self.write_u32(chunk.iter().fold(0, |v, &b| v << 8 | u32::from(b)));
        }
    }
    fn write_u32(&mut self, v: u32) {
        self.0 = (self.0.rotate_left(21) ^ u64::from(v)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }
    fn write_i32(&mut self, v: i32) {
        self.write_u32(v as u32);
    }
    fn write_usize(&mut self, v: usize) {
        self.0 ^= v as u64;
    }
}

/// Table from key to slot.
pub type BlockTable = HashMap<BlockKey, u32, BuildHasherDefault<KeyHasher>>;

/// Items per page.
const PAGE: usize = 32;

/// Memory in pages of equal items, so that growing copies nothing; freed slots are reused.
#[derive(Clone, Default)]
pub struct Pages<T> {
    pages: Vec<Box<[T]>>,
    free: Vec<u32>,
    used: usize,
}

impl<T: Clone + Default> Pages<T> {
    /// Allocates a slot holding `T::default()`.
    pub fn take(&mut self) -> u32 {
        if let Some(slot) = self.free.pop() {
            *self.at_mut(slot) = T::default();
            return slot;
        }
        if self.used == self.pages.len() * PAGE {
            self.pages.push(vec![T::default(); PAGE].into_boxed_slice());
        }
        self.used += 1;
        (self.used - 1) as u32
    }

    /// Frees a slot.
    pub fn give_back(&mut self, slot: u32) {
        self.free.push(slot);
    }

    /// The item in a slot.
    pub fn at(&self, slot: u32) -> &T {
        &self.pages[slot as usize / PAGE][slot as usize % PAGE]
    }

    /// The item in a slot, mutable.
    pub fn at_mut(&mut self, slot: u32) -> &mut T {
        &mut self.pages[slot as usize / PAGE][slot as usize % PAGE]
    }

    /// Bytes of all pages.
    pub fn bytes(&self) -> usize {
        self.pages.len() * PAGE * size_of::<T>() + self.free.capacity() * 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn voxels_below_zero_lie_in_the_block_below() {
        assert_eq!(BlockKey::of_voxel([-1, 0, 8]), (BlockKey([-1, 0, 1]), 7));
        assert_eq!(BlockKey::of_voxel([-8, -9, 7]), (BlockKey([-1, -2, 0]), 7 * 8 + 7 * 64));
    }

    #[test]
    fn a_slot_given_back_is_used_again_and_clean() {
        let mut pages = Pages::<u64>::default();
        let slots: Vec<u32> = (0..100).map(|_| pages.take()).collect();
        *pages.at_mut(slots[40]) = 7;
        pages.give_back(slots[40]);
        assert_eq!(pages.take(), slots[40]);
        assert_eq!(*pages.at(slots[40]), 0);
        assert_eq!(pages.used, 100);
    }
}
