//! What has changed of the surfaces of submaps: for whoever shows them while they grow.

use super::{ColumnChange, DenseMap, SubmapView};
use crate::{BlockKey, Mesh, MeshConfig, Mesher};
use cairn_geometry::Se3;
use std::collections::{BTreeMap, BTreeSet};

/// The surfaces of submaps, as far as they differ from what was told before.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceChange {
    /// All submaps that there are: their numbers, and their poses in the map.
    pub submaps: Vec<(u32, Se3)>,
    /// Meshes of blocks in the frames of their submaps; one without triangles is gone.
    pub blocks: Vec<(u32, BlockKey, Mesh)>,
    /// Columns, where they are shown.
    pub columns: ColumnChange,
}

/// Meshes the blocks of submaps that have changed since it was asked last.
pub struct SurfaceChanges {
    mesher: Mesher,
    /// For each submap the revision of its field, and the blocks that it had.
    known: BTreeMap<u32, (u64, BTreeSet<BlockKey>)>,
}

impl SurfaceChanges {
    /// Nothing is known yet.
    pub fn new() -> Self {
        Self { mesher: Mesher::new(MeshConfig::of_key_frames()), known: BTreeMap::new() }
    }

    /// What has changed in this map, which is the same in every call.
    pub fn of(&mut self, map: &DenseMap) -> SurfaceChange {
        let submaps: Vec<SubmapView> = map.submaps().collect();
        let blocks = submaps.iter().flat_map(|submap| self.changed(submap)).collect();
        let submaps: Vec<(u32, Se3)> =
            submaps.iter().map(|s| (s.number as u32, s.world_from_submap)).collect();
        let numbers: BTreeSet<u32> = submaps.iter().map(|(number, _)| *number).collect();
        self.known.retain(|number, _| numbers.contains(number));
        SurfaceChange { submaps, blocks, columns: ColumnChange::default() }
    }

    /// The meshes of a submap's blocks that have changed since it was asked last.
    fn changed(&mut self, submap: &SubmapView) -> Vec<(u32, BlockKey, Mesh)> {
        // One that is released has not changed for long, or is shown when it is whole again.
        let (number, Some(field)) = (submap.number as u32, submap.tsdf) else { return Vec::new() };
        let (revision, had) = self.known.entry(number).or_default();
        if *revision == field.revision() {
            return Vec::new();
        }
        let has: BTreeSet<BlockKey> = field.changed_since(0).collect();
        // A block that is gone is none of those that have changed.
        let gone = Mesher::affected(had.difference(&has).copied());
        let mut out: Vec<(BlockKey, Mesh)> = self.mesher.changed(field, *revision).collect();
        let known: BTreeSet<BlockKey> = out.iter().map(|(key, _)| *key).collect();
        for key in gone.into_iter().filter(|key| !known.contains(key)) {
            out.push((key, self.mesher.block(field, key)));
        }
        (*revision, *had) = (field.revision(), has);
        out.into_iter().map(|(key, mesh)| (number, key, mesh)).collect()
    }
}

impl Default for SurfaceChanges {
    fn default() -> Self {
        Self::new()
    }
}
