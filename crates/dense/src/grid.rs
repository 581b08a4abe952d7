//! Slots of blocks in a dense array over their bounding box, for loops with many look-ups.

use crate::block::BlockKey;
use crate::tsdf::TsdfVolume;

/// No block at this place.
pub(crate) const NO_SLOT: u32 = u32::MAX;
/// No array is allocated for more cells than this.
const MOST_CELLS: usize = 1 << 24;

/// The places of a box of blocks in an array.
#[derive(Clone, Copy)]
pub(crate) struct Extent {
    low: [i32; 3],
    size: [usize; 3],
}

impl Extent {
    /// Around some blocks, with one more on all sides: of every block those next to it have a place, too. `None` without blocks, or where they
    /// are too far apart for an array.
    pub fn around(keys: impl Iterator<Item = BlockKey>) -> Option<Self> {
        let (mut low, mut high) = ([i32::MAX; 3], [i32::MIN; 3]);
        for key in keys {
            (0..3).for_each(|i| (low[i], high[i]) = (low[i].min(key.0[i]), high[i].max(key.0[i])));
        }
        if low[0] > high[0] {
            return None;
        }
        let low = low.map(|v| v - 1);
        let size: [usize; 3] = std::array::from_fn(|i| (high[i] - low[i] + 2) as usize);
        let places = size.iter().try_fold(1usize, |n, &s| n.checked_mul(s));
        places.is_some_and(|n| n <= MOST_CELLS).then_some(Self { low, size })
    }

    /// How many there are.
    pub fn places(&self) -> usize {
        self.size.iter().product()
    }

    /// Place of a block; `None` outside.
    #[inline(always)]
    pub fn place(&self, key: BlockKey) -> Option<usize> {
        let [x, y, z] = std::array::from_fn(|i| key.0[i].wrapping_sub(self.low[i]) as u32 as usize);
        let [width, height, depth] = self.size;
        (x < width && y < height && z < depth).then(|| x + width * (y + height * z))
    }

    /// From a block to itself and to those that come next along the axes, see [`BlockGrid::around`].
    pub fn next(&self) -> [usize; 8] {
        std::array::from_fn(|i| {
            let [x, y, z] = corner(i).map(|v| v as usize);
            x + self.size[0] * (y + self.size[1] * z)
        })
    }

    /// The slots of a field's blocks by their places; [`NO_SLOT`] where there is none.
    pub fn fill(&self, volume: &TsdfVolume, slots: &mut Vec<u32>) {
        slots.clear();
        slots.resize(self.places(), NO_SLOT);
        for (key, slot) in volume.slots() {
            if let Some(place) = self.place(key) {
                slots[place] = slot;
            }
        }
    }
}

/// The blocks of a field at one moment (a snapshot).
pub(crate) enum BlockGrid<'a> {
    /// One entry for each place in the box around all blocks.
    Dense { extent: Extent, slots: Vec<u32> },
    /// Blocks too far apart for an array: looked up in the field's own table.
    Sparse(&'a TsdfVolume),
}

impl<'a> BlockGrid<'a> {
    pub fn new(volume: &'a TsdfVolume) -> Self {
        let Some(extent) = Extent::around(volume.changed_since(0)) else { return Self::Sparse(volume) };
        let mut slots = Vec::new();
        extent.fill(volume, &mut slots);
        Self::Dense { extent, slots }
    }

    #[inline(always)]
    pub fn slot(&self, key: BlockKey) -> Option<u32> {
        match self {
            Self::Dense { extent, slots } => Some(slots[extent.place(key)?]).filter(|&s| s != NO_SLOT),
            Self::Sparse(volume) => volume.slot(key),
        }
    }

    /// Slots of a block, and of those that come next along the axes: bit 0 of the index selects the next one along x, and so on;
    /// [`NO_SLOT`] where there is none.
    pub fn around(&self, key: BlockKey) -> [u32; 8] {
        std::array::from_fn(|i| self.slot(key.offset(corner(i))).unwrap_or(NO_SLOT))
    }
}

/// Which of the next blocks along the axes has this number.
fn corner(i: usize) -> [i32; 3] {
    [i & 1, i >> 1 & 1, i >> 2].map(|v| v as i32)
}
