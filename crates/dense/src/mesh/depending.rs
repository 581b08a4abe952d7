//! Blocks whose meshes depend on what has changed of a field.

use crate::block::BlockKey;
use crate::grid::{BlockGrid, Extent, NO_SLOT};
use crate::tsdf::TsdfVolume;

/// Finds them; uses its memory again.
#[derive(Clone, Default)]
pub struct Depending {
    /// Slots of blocks by their places in the box around those that have changed.
    slots: Vec<u32>,
    /// Whether the block at a place depends on one that has changed.
    depends: Vec<bool>,
    found: Vec<(BlockKey, [u32; 8])>,
}

impl Depending {
    /// Blocks whose cells have corners in a block that has changed since a revision: itself, or one that comes next; with the slots of all
    /// these as [`BlockGrid::around`] gives them.
    pub fn find(&mut self, volume: &TsdfVolume, revision: u64) -> &[(BlockKey, [u32; 8])] {
        self.found.clear();
        if let Some(extent) = Extent::around(volume.changed_since(revision)) {
            self.find_in(extent, volume, revision);
        } else if volume.changed_since(revision).next().is_some() {
            let grid = BlockGrid::Sparse(volume);
            let all = volume.slots().map(|(key, _)| (key, grid.around(key)));
            let has_changed = |slot: &u32| *slot != NO_SLOT && volume.changed_at(*slot) > revision;
            self.found.extend(all.filter(|(_, slots)| slots.iter().any(has_changed)));
        }
        &self.found
    }

    fn find_in(&mut self, extent: Extent, volume: &TsdfVolume, revision: u64) {
        extent.fill(volume, &mut self.slots);
        self.depends.clear();
        self.depends.resize(self.slots.len(), false);
        let next = extent.next();
        for place in volume.changed_since(revision).filter_map(|key| extent.place(key)) {
            next.iter().for_each(|next| self.depends[place - next] = true);
        }
        for (key, _) in volume.slots() {
            if let Some(place) = extent.place(key).filter(|&place| self.depends[place]) {
                self.found.push((key, next.map(|next| self.slots[place + next])));
            }
        }
    }
}
