//! Slots of blocks in a dense array over their bounding box, for loops with many look-ups.

use crate::block::BlockKey;
use crate::tsdf::TsdfVolume;

/// No block at this place.
pub(crate) const NO_SLOT: u32 = u32::MAX;
/// No array is allocated for more cells than this.
const MOST_CELLS: usize = 1 << 24;

/// The blocks of a field at one moment (a snapshot).
pub(crate) enum BlockGrid<'a> {
    /// One entry for each place in the bounding box, and for those around it.
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
        // One more on all sides: of every block those next to it have a place, too.
        let low = low.map(|v| v - 1);
        let size: [usize; 3] = std::array::from_fn(|i| (high[i] - low[i] + 2) as usize);
        let cells = size.iter().try_fold(1usize, |n, &s| n.checked_mul(s)).filter(|&n| n <= MOST_CELLS);
        let Some(cells) = cells else { return Self::Sparse(volume) };
        let mut slots = vec![NO_SLOT; cells];
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
                Some(slots[x as usize + size[0] * (y as usize + size[1] * z as usize)])
                    .filter(|&s| s != NO_SLOT)
            }
            Self::Sparse(volume) => volume.slot(key),
        }
    }

    /// Slots of a block, and of those that come next along the axes: bit 0 of the index selects the next one along x, and so on;
    /// [`NO_SLOT`] where there is none.
    pub fn around(&self, key: BlockKey) -> [u32; 8] {
        std::array::from_fn(|i| self.slot(key.offset(corner(i))).unwrap_or(NO_SLOT))
    }

    /// Blocks whose cells have corners in a block that has changed since a revision: itself, or one that comes next; with the slots of
    /// all these as [`Self::around`] gives them.
    pub fn depending(
        self,
        volume: &'a TsdfVolume,
        revision: u64,
    ) -> impl Iterator<Item = (BlockKey, [u32; 8])> + 'a {
        let has_changed = move |slot: u32| volume.changed_at(slot) > revision;
        let places = if let Self::Dense { low, size, .. } = self { Some((low, size)) } else { None };
        let place = |key: BlockKey, (low, size): ([i32; 3], [usize; 3])| {
            let at: [usize; 3] = std::array::from_fn(|i| (key.0[i] - low[i]) as usize);
            at[0] + size[0] * (at[1] + size[1] * at[2])
        };
        let (mut depends, mut next) = (Vec::new(), [0; 8]);
        if let Self::Dense { low, size, slots } = &self {
            depends.resize(slots.len(), false);
            next = std::array::from_fn(|i| {
                let [x, y, z] = corner(i).map(|v| v as usize);
                x + size[0] * (y + size[1] * z)
            });
            for (key, _) in volume.slots().filter(|&(_, slot)| has_changed(slot)) {
                let at = place(key, (*low, *size));
                next.iter().for_each(|next| depends[at - next] = true);
            }
        }
        volume.slots().filter_map(move |(key, _)| {
            let Some(places) = places else {
                let slots = self.around(key);
                return slots.iter().any(|&s| s != NO_SLOT && has_changed(s)).then_some((key, slots));
            };
            let at = place(key, places);
            let Self::Dense { slots, .. } = &self else { return None };
            if !depends[at] {
                return None;
            }
            let mut around = [NO_SLOT; 8];
            around.iter_mut().zip(next).for_each(|(slot, next)| *slot = slots[at + next]);
            Some((key, around))
        })
    }
}

/// Which of the next blocks along the axes has this number.
fn corner(i: usize) -> [i32; 3] {
    [i & 1, i >> 1 & 1, i >> 2].map(|v| v as i32)
}
