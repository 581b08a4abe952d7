//! Depth of key frames in submaps that follow the map: a correction of the map moves the poses of submaps; only key
//! frames that moved inside their submap are re-fused, in slices.
//!
//! After Reijgwart et al., "Voxgraph" (RA-L 2020), section III, for submaps anchored to the pose graph, and Dai et
//! al., "BundleFusion" (TOG 2017), section 5, for removing images and fusing them again.

mod changes;
mod codec;
mod columns;
mod field;
mod forget;
mod locate;
mod refuse;
mod saved;
#[cfg(test)]
mod tests;
mod whole;

pub use changes::{SurfaceChange, SurfaceChanges};
pub use codec::{PackedDepth, PackedGray};
pub(crate) use codec::{Rows, broken};
pub use columns::{ColumnChange, ColumnChanges};
pub use locate::{Followed, Located, Locator, Place};
pub use refuse::Progress;
pub use saved::{SavedFrame, SavedSubmap};

use crate::block::BlockKey;
use crate::prepare::DepthPreparer;
use crate::tsdf::Window;
use crate::{
    Backend, DenseError, DepthConfig, DepthFrame, Fused, OccupancyConfig, OccupancyGrid, TsdfConfig,
    TsdfVolume,
};
use cairn_geometry::{Se3, Sim3};
use cairn_sensor::{Camera, DepthImage, GrayImage};
use field::Field;
use std::collections::BTreeMap;
use std::sync::Arc;

/// A key frame of the map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct AnchorId(pub u64);

/// A map of the atlas; the relative pose of different maps is unknown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct MapId(pub u64);

/// Configuration of submaps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SubmapConfig {
    /// How depth images are interpreted.
    pub depth: DepthConfig,
    /// The field, which has no colours itself; with colour the gray images of key frames are kept beside their depth for surfaces
    /// of whole maps.
    pub tsdf: TsdfConfig,
    /// The occupancy grid.
    pub occupancy: OccupancyConfig,
    /// Key frames within this distance of a submap's origin go into it, in metres.
    pub reach_m: f64,
    /// A key frame goes into a submap only when at least this share of its blocks is in it.
    pub overlap: f64,
    /// Key frames that moved less than this inside their submap, measured 2 m in front of the camera, are not
    /// re-fused; in metres.
    pub moved_m: f64,
    /// Bytes that the fields of all submaps may take: those that nothing was added to for longest are released, and fused
    /// again from the stored depth when something is added to them or all are wanted ([`DenseMap::want_all`]).
    pub most_bytes: usize,
}

impl Default for SubmapConfig {
    fn default() -> Self {
        Self {
            depth: DepthConfig::default(),
            tsdf: TsdfConfig::default(),
            occupancy: OccupancyConfig::default(),
            reach_m: 3.0,
            overlap: 0.2,
            moved_m: 0.01,
            // Two submaps of a simulated apartment at 2 cm.
            most_bytes: 48 << 20,
        }
    }
}

/// A pose relative to an anchor: `anchor_from_this`.
#[derive(Clone, Copy, Debug, PartialEq)]
struct AnchoredPose {
    anchor: AnchorId,
    pose: Se3,
}

/// A submap: its volumes and its place.
struct Submap {
    anchored: AnchoredPose,
    field: Field,
    /// The number of the last image that was added, among all of the map.
    used: usize,
    /// Shared with searches that run meanwhile, as the field.
    occupancy: Arc<OccupancyGrid>,
    /// Occupancy being rebuilt, with the next of its frames to be fused.
    rebuilt: Option<(OccupancyGrid, usize)>,
    /// The occupancy was built with other poses than the field.
    stale: bool,
}

/// The depth of a key frame.
struct Kept {
    /// The key frame that it is of, where that is known; it may have been removed.
    key_frame: Option<AnchorId>,
    anchored: AnchoredPose,
    /// Where it is fused; `None` for one of a saved map that is still to be fused.
    inside: Option<Inside>,
    /// Its destination: another submap, after two are joined.
    target: usize,
    depth: PackedDepth,
    gray: Option<PackedGray>,
}

/// The submap that a frame is fused in, and its pose there as it was fused.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Inside {
    submap: usize,
    pose: Se3,
}

impl Kept {
    fn bytes(&self) -> usize {
        self.depth.bytes() + self.gray.as_ref().map_or(0, |gray| gray.as_bytes().len())
    }

    /// The pose with which it is fused in a submap.
    fn inside(&self, submap: usize) -> Option<&Se3> {
        self.inside.as_ref().filter(|i| i.submap == submap).map(|i| &i.pose)
    }
}

#[derive(Clone, Copy, Debug)]
struct Anchor {
    map: MapId,
    world_from_anchor: Se3,
}

/// One submap, for reading.
pub struct SubmapView<'a> {
    /// Its number, which no other submap of the same [`DenseMap`] gets.
    pub number: usize,
    /// The map it belongs to.
    pub map: MapId,
    /// Its pose in that map.
    pub world_from_submap: Se3,
    /// Its surface; `None` while it is released.
    pub tsdf: Option<&'a TsdfVolume>,
    /// Its free space.
    pub occupancy: &'a OccupancyGrid,
}

/// All submaps of all maps.
pub struct DenseMap {
    config: SubmapConfig,
    preparer: DepthPreparer,
    /// Blocks around the surface of an image.
    around: (Window, Vec<BlockKey>),
    anchors: BTreeMap<AnchorId, Anchor>,
    submaps: Vec<Option<Submap>>,
    kept: Vec<Kept>,
    /// Frames that moved inside their submap, or are to move to another.
    waiting: Vec<usize>,
    /// The submap that the last key frame of each map was fused into.
    active: BTreeMap<MapId, usize>,
    /// Images that were added so far.
    added: usize,
    /// No field may be released.
    are_all_wanted: bool,
}

impl DenseMap {
    /// Creates an empty dense map for one depth camera.
    ///
    /// # Errors
    /// An invalid camera or config.
    pub fn new(config: SubmapConfig, camera: Camera, metres_per_unit: f64) -> Result<Self, DenseError> {
        if !(config.reach_m > 0.0 && (0.0..1.0).contains(&config.overlap) && config.moved_m > 0.0) {
            return Err(DenseError::Config(format!("submaps: {config:?}")));
        }
        TsdfVolume::new(config.tsdf)?;
        OccupancyGrid::new(config.occupancy)?;
        Ok(Self {
            config,
            preparer: DepthPreparer::new(config.depth, camera, metres_per_unit)?,
            around: Default::default(),
            anchors: BTreeMap::new(),
            submaps: Vec::new(),
            kept: Vec::new(),
            waiting: Vec::new(),
            active: BTreeMap::new(),
            added: 0,
            are_all_wanted: false,
        })
    }

    /// The depth camera, and the metres of a unit of its images.
    pub fn camera(&self) -> (Camera, f64) {
        self.preparer.source()
    }

    /// Adds a key frame with its depth: it goes into the submap it overlaps most, or starts a new one. `gray` shows the same pixels
    /// as the depth; it is left aside where the field has no colours.
    ///
    /// # Errors
    /// A key frame that exists already, a pose that is not finite, depth that cannot be used. The map is then
    /// unchanged.
    pub fn insert(
        &mut self,
        id: AnchorId,
        map: MapId,
        world_from_anchor: Se3,
        anchor_from_camera: Se3,
        depth: &DepthImage,
        gray: Option<&GrayImage>,
    ) -> Result<Fused, DenseError> {
        if self.anchors.contains_key(&id) {
            return Err(DenseError::Pose(format!("key frame {} is in the map already", id.0)));
        }
        let world_from_camera = world_from_anchor * anchor_from_camera;
        if !world_from_camera.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        let frame = self.preparer.prepare(depth)?.clone();
        let gray = gray.filter(|_| self.config.tsdf.colour);
        gray.map_or(Ok(()), |gray| self.preparer.check("colour", [gray.width(), gray.height()]))?;
        let chosen = self.choose(map, &world_from_camera, &frame);
        let anchored = AnchoredPose { anchor: id, pose: Se3::identity() };
        let anchor = Anchor { map, world_from_anchor };
        let mut fresh = None;
        let (index, pose) = match chosen {
            Some(index) => (index, self.world_from_submap(index)?.inverse() * world_from_camera),
            None => {
                fresh = Some(self.empty_submap(anchored)?);
                (self.submaps.len(), anchor_from_camera)
            }
        };
        mark(&mut self.around, &self.config.tsdf, &frame, &pose)?;
        let submap = match fresh.as_mut() {
            Some(fresh) => fresh,
            None => self.submaps[index].as_mut().ok_or(DenseError::UnknownAnchor(id.0))?,
        };
        let result = submap.field.add(self.kept.len(), &frame, &pose, &self.around.1)?;
        Arc::make_mut(&mut submap.occupancy).integrate(&frame, &pose)?;
        self.added += 1;
        submap.used = self.added;
        self.submaps.extend(fresh.map(Some));
        self.anchors.insert(id, anchor);
        self.active.insert(map, index);
        let anchored = AnchoredPose { anchor: id, pose: anchor_from_camera };
        let inside = Some(Inside { submap: index, pose });
        let (depth, gray) = (PackedDepth::pack(depth), gray.map(PackedGray::pack));
        self.kept.push(Kept { key_frame: Some(id), anchored, inside, target: index, depth, gray });
        self.release_fields();
        Ok(result)
    }

    fn empty_submap(&self, anchored: AnchoredPose) -> Result<Submap, DenseError> {
        let field = Field::new(self.fields())?;
        let occupancy = Arc::new(OccupancyGrid::new(self.config.occupancy)?);
        Ok(Submap { anchored, field, used: self.added, occupancy, rebuilt: None, stale: false })
    }

    /// The submap of a map that is near enough and holds the greatest share of an image's blocks.
    fn choose(&mut self, map: MapId, world_from_camera: &Se3, frame: &DepthFrame) -> Option<usize> {
        let mut best: Option<(usize, f64)> = None;
        for index in 0..self.submaps.len() {
            let Some((in_map, world_from_submap)) = self.place(index) else { continue };
            let away = (world_from_submap.translation - world_from_camera.translation).norm();
            if in_map != map || away > self.config.reach_m {
                continue;
            }
            let pose = world_from_submap.inverse() * *world_from_camera;
            let Some(submap) = self.submaps[index].as_ref() else { continue };
            if mark(&mut self.around, &self.config.tsdf, frame, &pose).is_err() {
                continue;
            }
            let around = &self.around.1;
            let known = around.iter().filter(|key| submap.field.has(**key)).count();
            let share = known as f64 / around.len().max(1) as f64;
            if share >= self.config.overlap && best.is_none_or(|(_, most)| share > most) {
                best = Some((index, share));
            }
        }
        best.map(|(index, _)| index)
    }

    /// Map and pose of a submap.
    fn place(&self, index: usize) -> Option<(MapId, Se3)> {
        let anchored = self.submaps.get(index)?.as_ref()?.anchored;
        let anchor = self.anchors.get(&anchored.anchor)?;
        Some((anchor.map, anchor.world_from_anchor * anchored.pose))
    }

    fn world_from_submap(&self, index: usize) -> Result<Se3, DenseError> {
        self.place(index).map(|(_, pose)| pose).ok_or(DenseError::UnknownAnchor(index as u64))
    }

    /// Key frames have moved: submaps are at their new poses when this returns. Frames that moved inside their submap
    /// are left to [`Self::step`]. Unknown ids are ignored: they have no depth.
    ///
    /// # Errors
    /// A pose that is not finite; nothing is moved then.
    pub fn align(&mut self, moved: &[(AnchorId, Se3)]) -> Result<(), DenseError> {
        if moved.iter().any(|(_, pose)| !pose.is_finite()) {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        for (id, pose) in moved {
            if let Some(anchor) = self.anchors.get_mut(id) {
                anchor.world_from_anchor = *pose;
            }
        }
        self.find_moved();
        Ok(())
    }

    /// Merges a map into another, moved by a similarity. Depth is metric: the scale moves poses and changes no
    /// volume. Submaps that now overlap are joined by [`Self::step`].
    ///
    /// # Errors
    /// A similarity that is not finite.
    pub fn merge(&mut self, from: MapId, into: MapId, into_from_from: &Sim3) -> Result<(), DenseError> {
        if !into_from_from.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        let submaps: Vec<usize> =
            (0..self.submaps.len()).filter(|&i| self.place(i).is_some_and(|(map, _)| map == from)).collect();
        for anchor in self.anchors.values_mut().filter(|a| a.map == from) {
            anchor.map = into;
            anchor.world_from_anchor = into_from_from.transform_pose(&anchor.world_from_anchor);
        }
        if let Some(active) = self.active.remove(&from) {
            self.active.entry(into).or_insert(active);
        }
        if from != into {
            submaps.into_iter().for_each(|index| self.join(index, into));
        }
        self.find_moved();
        Ok(())
    }

    /// Schedules the frames of a submap to move to the nearest other submap of the map within reach.
    fn join(&mut self, index: usize, map: MapId) {
        let Some((_, own)) = self.place(index) else { return };
        let others = (0..self.submaps.len()).filter(|&i| i != index && !self.leaves(i));
        let nearest = others
            .filter_map(|i| self.place(i).filter(|(m, _)| *m == map).map(|(_, p)| (i, p)))
            .map(|(i, p)| (i, (p.translation - own.translation).norm()))
            .filter(|(_, away)| *away <= self.config.reach_m)
            .min_by(|a, b| a.1.total_cmp(&b.1));
        let Some((target, _)) = nearest else { return };
        self.kept.iter_mut().filter(|k| k.target == index).for_each(|k| k.target = target);
        self.active.values_mut().filter(|a| **a == index).for_each(|a| *a = target);
        let used = self.submaps[index].as_ref().map_or(0, |s| s.used);
        self.submaps[target].iter_mut().for_each(|s| s.used = s.used.max(used));
    }

    /// Whether all frames of a submap are scheduled to move to another.
    fn leaves(&self, index: usize) -> bool {
        self.kept.iter().all(|k| k.target != index)
    }

    /// Removes a key frame; its depth, and submaps anchored to it, are anchored to its parent instead.
    ///
    /// # Errors
    /// An unknown parent, while something is anchored to the key frame.
    pub fn remove(&mut self, id: AnchorId, parent: AnchorId) -> Result<(), DenseError> {
        let Some(gone) = self.anchors.get(&id).copied() else { return Ok(()) };
        let to =
            self.anchors.get(&parent).filter(|_| parent != id).ok_or(DenseError::UnknownAnchor(parent.0))?;
        let parent_from_gone = to.world_from_anchor.inverse() * gone.world_from_anchor;
        let submaps = self.submaps.iter_mut().flatten().map(|s| &mut s.anchored);
        for anchored in
            submaps.chain(self.kept.iter_mut().map(|k| &mut k.anchored)).filter(|h| h.anchor == id)
        {
            *anchored = AnchoredPose { anchor: parent, pose: parent_from_gone * anchored.pose };
        }
        self.anchors.remove(&id);
        Ok(())
    }

    /// Adds a key frame that has no depth itself but may become the parent of others.
    ///
    /// # Errors
    /// A pose that is not finite.
    pub fn add_anchor(&mut self, id: AnchorId, map: MapId, world_from_anchor: Se3) -> Result<(), DenseError> {
        if !world_from_anchor.is_finite() {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        self.anchors.entry(id).or_insert(Anchor { map, world_from_anchor });
        Ok(())
    }

    /// All submaps, oldest first.
    pub fn submaps(&self) -> impl Iterator<Item = SubmapView<'_>> {
        self.submaps.iter().enumerate().filter_map(|(number, submap)| {
            let (map, world_from_submap) = self.place(number)?;
            let Submap { field, occupancy, .. } = submap.as_ref()?;
            let tsdf = field.whole().map(|field| &**field);
            Some(SubmapView { number, map, world_from_submap, tsdf, occupancy })
        })
    }

    /// Bytes of the volumes, and of the stored images.
    pub fn bytes(&self) -> [usize; 2] {
        let volumes = self.submaps.iter().flatten().map(|s| s.field.bytes() + s.occupancy.bytes()).sum();
        [volumes, self.kept.iter().map(Kept::bytes).sum()]
    }
}

/// Finds the blocks around the surface of an image.
fn mark(
    (window, keys): &mut (Window, Vec<BlockKey>),
    config: &TsdfConfig,
    frame: &DepthFrame,
    pose: &Se3,
) -> Result<(), DenseError> {
    let band_m = config.voxel_m * config.band_voxels;
    window.mark(frame, pose, config.voxel_m, band_m, Backend::best())?;
    window.keys(keys);
    Ok(())
}
