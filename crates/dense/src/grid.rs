//! Slots of blocks in a dense array over their bounding box, for loops with many look-ups.

use crate::block::BlockKey;
use crate::tsdf::TsdfVolume;

/// No block at this place.
const NONE: u32 = u32::MAX;
/// No array is allocated for more cells than this.
const MOST_CELLS: usize = 1 << 24;

/// The blocks of a field at one moment (a snapshot).
pub(crate) enum BlockGrid<'a> {
    /// One entry for each place in the bounding box.
    Dense { low: [i32; 3], size: [usize; 3], slots: Vec<u32> },
    /// Blocks too far apart for an array: looked up in the field's own table.
    Sparse(&'a TsdfVolume),
}

impl<'a> BlockGrid<'a> {
    pub fn new(volume: &'a TsdfVolume) -> Self {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for key in volume.changed_since(0) {
            (0..3).for_each(|i| (low[i], high[i]) = (low[i].min(key.0[i]), high[i].max(key.0[i])));
        }
        if volume.blocks() == 0 {
            return Self::Sparse(volume);
        }
        let size: [usize; 3] = std::array::from_fn(|i| (high[i] - low[i] + 1) as usize);
        let cells = size.iter().try_fold(1usize, |n, &s| n.checked_mul(s)).filter(|&n| n <= MOST_CELLS);
        let Some(cells) = cells else { return Self::Sparse(volume) };
        let mut slots = vec![NONE; cells];
        for (key, slot) in volume.slots() {
            let at: [usize; 3] = std::array::from_fn(|i| (key.0[i] - low[i]) as usize);
            slots[at[0] + size[0] * (at[1] + size[1] * at[2])] = slot;
        }
        Self::Dense { low, size, slots }
    }

    #[inline(always)]
    pub fn slot(&self, key: BlockKey) -> Option<u32> {
        match self {
            Self::Dense { low, size, slots } => {
                let along = |i: usize| key.0[i].wrapping_sub(low[i]) as u32;
                let (x, y, z) = (along(0), along(1), along(2));
                if x as usize >= size[0] || y as usize >= size[1] || z as usize >= size[2] {
                    return None;
                }
                Some(slots[x as usize + size[0] * (y as usize + size[1] * z as usize)]).filter(|&s| s != NONE)
            }
            Self::Sparse(volume) => volume.slot(key),
        }
    }
}
