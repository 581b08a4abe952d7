//! Surfaces and free space of whole maps, fused from the stored depth with the poses of now: without seams between submaps.
//!
//! A map has walls that were seen from both sides. Truncation distances wider than such a wall would push its sides apart, so that with
//! large voxels it is shorter here than the config says.

use super::{AnchorId, AnchoredPose, DenseMap, Kept, MapId, mark};
use crate::block::{BlockKey, KeyHasher};
use crate::tsdf::TsdfVolume;
use crate::{ColourImage, DenseError, Mesh, MeshConfig, Mesher, OccupancyConfig, OccupancyGrid, TsdfConfig};
use cairn_geometry::Se3;
use std::collections::HashSet;
use std::hash::BuildHasherDefault;

/// Thickness of a thin wall, metres; and the voxels of a truncation distance that a surface needs at least.
const WALL_M: f64 = 0.1;
const LEAST_BAND: f64 = 2.5;
/// Bytes of the field that a surface is meshed from at a time; a larger map is meshed in parts.
const PART_BYTES: usize = 48 << 20;

impl DenseMap {
    /// One field of a whole map. It has colours where they are asked for and images of the map have them.
    ///
    /// # Errors
    /// A config value out of range; poses out of range.
    pub fn fuse_all(&mut self, map: MapId, tsdf: TsdfConfig) -> Result<TsdfVolume, DenseError> {
        self.fuse_in_order(map, tsdf, |_, _| ())
    }

    /// As [`Self::fuse_all`], in the order of the key frames; `after` gets the key frame of each image and the field with it.
    ///
    /// # Errors
    /// As those of [`Self::fuse_all`].
    pub fn fuse_in_order(
        &mut self,
        map: MapId,
        tsdf: TsdfConfig,
        mut after: impl FnMut(AnchorId, &TsdfVolume),
    ) -> Result<TsdfVolume, DenseError> {
        let mut out = TsdfVolume::new(self.config_of_whole(map, tsdf)?)?;
        for number in self.in_order(map) {
            self.fuse_into(&mut out, number)?;
            after(self.kept[number].anchored.anchor, &out);
        }
        Ok(out)
    }

    /// The surface of a whole map, welded, as [`Self::fuse_all`] has it: a large map is fused and meshed in parts, so that no field of all
    /// of it is needed.
    ///
    /// # Errors
    /// As those of [`Self::fuse_all`].
    pub fn surface(&mut self, map: MapId, tsdf: TsdfConfig, config: MeshConfig) -> Result<Mesh, DenseError> {
        self.surface_in_parts(map, tsdf, config, PART_BYTES)
    }

    pub(super) fn surface_in_parts(
        &mut self,
        map: MapId,
        tsdf: TsdfConfig,
        config: MeshConfig,
        part_bytes: usize,
    ) -> Result<Mesh, DenseError> {
        let tsdf = self.config_of_whole(map, tsdf)?;
        let order = self.in_order(map);
        let mut blocks = HashSet::<BlockKey, BuildHasherDefault<KeyHasher>>::default();
        let mut extents = Vec::with_capacity(order.len());
        for &number in &order {
            let pose = self.world_from_image(number)?;
            let frame = self.preparer.prepare_packed(&self.kept[number].depth)?;
            mark(&mut self.around, &tsdf, frame, &pose)?;
            extents.push(Region::around(&self.around.1));
            blocks.extend(&self.around.1);
        }
        let mut parts = Vec::new();
        split(blocks.into_iter().collect(), part_bytes / TsdfVolume::block_bytes(&tsdf), &mut parts);
        let (mut mesher, mut mesh) = (Mesher::new(config), Mesh::default());
        for part in parts {
            // A block is meshed with those after it.
            let with_next = Region { low: part.low, high: part.high.map(|v| v + 1) };
            let mut field = TsdfVolume::new(tsdf)?.within(with_next.low, with_next.high);
            for (&number, extent) in order.iter().zip(&extents) {
                if extent.meets(&with_next) {
                    self.fuse_into(&mut field, number)?;
                }
            }
            let own = field.changed_since(0).filter(|key| part.has(key));
            mesher.add(&field, own, &mut mesh);
        }
        mesh.finish();
        Ok(mesh)
    }

    /// The images of a map in the order of its key frames.
    fn in_order(&self, map: MapId) -> Vec<usize> {
        let mut order: Vec<usize> =
            (0..self.kept.len()).filter(|&n| self.is_of(&self.kept[n], map)).collect();
        order.sort_by_key(|&n| self.kept[n].anchored.anchor);
        order
    }

    fn is_of(&self, kept: &Kept, map: MapId) -> bool {
        self.anchors.get(&kept.anchored.anchor).is_some_and(|a| a.map == map)
    }

    fn world_from_image(&self, number: usize) -> Result<Se3, DenseError> {
        let AnchoredPose { anchor, pose } = self.kept[number].anchored;
        let known = self.anchors.get(&anchor).ok_or(DenseError::UnknownAnchor(anchor.0))?;
        Ok(known.world_from_anchor * pose)
    }

    fn config_of_whole(&self, map: MapId, tsdf: TsdfConfig) -> Result<TsdfConfig, DenseError> {
        // A config out of range is refused.
        TsdfVolume::new(tsdf)?;
        let colour = tsdf.colour && self.kept.iter().any(|k| k.gray.is_some() && self.is_of(k, map));
        let band_voxels = tsdf.band_voxels.min((WALL_M / tsdf.voxel_m).max(LEAST_BAND));
        Ok(TsdfConfig { colour, band_voxels, ..tsdf })
    }

    fn fuse_into(&mut self, field: &mut TsdfVolume, number: usize) -> Result<(), DenseError> {
        let (pose, kept) = (self.world_from_image(number)?, &self.kept[number]);
        let gray = kept.gray.as_ref().filter(|_| field.config().colour);
        let mut colours = ColourImage::default();
        let colours = self.preparer.colours_packed(gray, &mut colours)?;
        field.integrate(self.preparer.prepare_packed(&kept.depth)?, colours, &pose)?;
        Ok(())
    }

    /// The occupancy of a whole map in its own frame, from the stored depth with the current poses.
    ///
    /// # Errors
    /// A config value out of range; poses out of range.
    pub fn occupancy_of_all(
        &mut self,
        map: MapId,
        config: OccupancyConfig,
    ) -> Result<OccupancyGrid, DenseError> {
        let mut out = OccupancyGrid::new(config)?;
        for kept in &self.kept {
            let Some(anchor) = self.anchors.get(&kept.anchored.anchor).filter(|a| a.map == map) else {
                continue;
            };
            let frame = self.preparer.prepare_packed_for_occupancy(&kept.depth)?;
            out.integrate(frame, &(anchor.world_from_anchor * kept.anchored.pose))?;
        }
        Ok(out)
    }
}

/// A box of blocks: from the lowest to the highest.
#[derive(Clone, Copy)]
struct Region {
    low: [i32; 3],
    high: [i32; 3],
}

impl Region {
    fn around(keys: &[BlockKey]) -> Self {
        let none = Self { low: [i32::MAX; 3], high: [i32::MIN; 3] };
        keys.iter().fold(none, |all, key| Self {
            low: std::array::from_fn(|k| all.low[k].min(key.0[k])),
            high: std::array::from_fn(|k| all.high[k].max(key.0[k])),
        })
    }

    fn has(&self, key: &BlockKey) -> bool {
        (0..3).all(|k| (self.low[k]..=self.high[k]).contains(&key.0[k]))
    }

    fn meets(&self, other: &Self) -> bool {
        (0..3).all(|k| self.low[k] <= other.high[k] && other.low[k] <= self.high[k])
    }
}

/// Halves a set of blocks across its longest side until no part has more than `most`.
fn split(mut keys: Vec<BlockKey>, most: usize, parts: &mut Vec<Region>) {
    let region = Region::around(&keys);
    let length = |k: usize| i64::from(region.high[k]) - i64::from(region.low[k]);
    let longest = (0..3).max_by_key(|&k| length(k)).unwrap_or(0);
    if keys.len() <= most.max(1) || length(longest) < 1 {
        parts.extend((!keys.is_empty()).then_some(region));
        return;
    }
    let middle = keys.len() / 2;
    let (_, at, _) = keys.select_nth_unstable_by_key(middle, |key| key.0[longest]);
    // The second half begins here; it is not empty, and neither is the first.
    let from = at.0[longest].max(region.low[longest] + 1);
    let (first, second) = keys.into_iter().partition(|key| key.0[longest] < from);
    split(first, most, parts);
    split(second, most, parts);
}
