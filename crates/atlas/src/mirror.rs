//! A mirror of the key frames of an atlas, kept up to date by the stream of changes alone.

use crate::change::scaling_about;
use crate::{Change, KeyFrameId, MapId, MapPrior, Published, Removed, Snapshot};
use cairn_geometry::{Se3, Sim3};
use std::collections::BTreeMap;

/// A key frame as a subscriber knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirrored {
    /// The map it belongs to.
    pub map: MapId,
    /// The pose of the camera.
    pub world_from_camera: Se3,
    /// Map units per unit of what is anchored to it.
    pub unit: f64,
}

impl Mirrored {
    /// The pose with the unit.
    pub fn world_from_here(&self) -> Sim3 {
        Sim3::new(self.world_from_camera.rotation, self.world_from_camera.translation, self.unit)
    }
}

/// The poses and maps of all key frames, and the parents of removed ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mirror {
    version: u64,
    key_frames: BTreeMap<KeyFrameId, Mirrored>,
    removed: BTreeMap<KeyFrameId, (KeyFrameId, Sim3)>,
    maps: BTreeMap<MapId, Option<MapPrior>>,
}

impl Mirror {
    /// A mirror of one snapshot.
    pub fn of(snapshot: &Snapshot) -> Self {
        let mirrored = |k: &crate::KeyFrame| Mirrored {
            map: k.map,
            world_from_camera: k.world_from_camera,
            unit: k.unit,
        };
        Self {
            version: snapshot.version,
            key_frames: snapshot.key_frames().map(|k| (k.id, mirrored(k))).collect(),
            removed: snapshot
                .removed
                .iter()
                .filter_map(|(i, g)| Some((KeyFrameId::from_index(i)?, *g)))
                .collect(),
            maps: snapshot.maps.as_ref().clone(),
        }
    }

    /// Applies one commit; each must be passed once and in order.
    pub fn take(&mut self, published: &Published) {
        self.take_with(published, |_, _, _| {});
    }

    /// As [`Mirror::take`]; `then` is called after each change with the mirror as it is by then, and for a removed key
    /// frame with what took over.
    pub fn take_with(
        &mut self,
        published: &Published,
        mut then: impl FnMut(&Self, &Change, Option<&Removed>),
    ) {
        self.version = published.version;
        let mut removals = published.removed.iter();
        for change in &published.changes {
            let mut removal = None;
            match change {
                Change::AddKeyFrame(k) => {
                    let parents_map = k.parent.and_then(|p| self.key_frames.get(&p)).map(|p| p.map);
                    let map = parents_map.unwrap_or(MapId(k.id));
                    if k.parent.is_none() {
                        self.maps.insert(map, None);
                    }
                    let mirrored = Mirrored { map, world_from_camera: k.world_from_camera, unit: k.unit };
                    self.key_frames.insert(k.id, mirrored);
                }
                Change::MoveKeyFrame(id, pose) => {
                    if let Some(k) = self.key_frames.get_mut(id) {
                        k.world_from_camera = *pose;
                    }
                }
                Change::Scale(id, factor) => {
                    if let Some(k) = self.key_frames.get_mut(id) {
                        k.unit *= factor;
                    }
                }
                Change::MapPrior(map, map_prior) => {
                    self.maps.insert(*map, Some(*map_prior));
                }
                Change::Merge { from, into, into_from, .. } => {
                    for k in self.key_frames.values_mut().filter(|k| k.map == *from) {
                        k.map = *into;
                        k.world_from_camera = into_from.transform_pose(&k.world_from_camera);
                        k.unit *= into_from.scale;
                    }
                    self.maps.remove(from);
                }
                Change::AlignGravity(map, aligned_from_world) => {
                    for k in self.key_frames.values_mut().filter(|k| k.map == *map) {
                        k.world_from_camera = aligned_from_world.transform_pose(&k.world_from_camera);
                        k.unit *= aligned_from_world.scale;
                    }
                }
                Change::Rescale(map, factor) => {
                    let root = self.key_frames.get(&map.root()).map(|k| k.world_from_camera.translation);
                    let by = root.map(|root| scaling_about(&root, *factor)).unwrap_or_else(Sim3::identity);
                    for k in self.key_frames.values_mut().filter(|k| k.map == *map) {
                        k.world_from_camera = by.transform_pose(&k.world_from_camera);
                        k.unit *= by.scale;
                    }
                }
                Change::RemoveKeyFrame(id) => {
                    self.key_frames.remove(id);
                    removal = removals.next();
                    if let Some(r) = removal {
                        self.removed.insert(r.key_frame, (r.parent, r.parent_from_it));
                    }
                }
                Change::AddLandmark(..)
                | Change::MoveLandmark(..)
                | Change::Observe(..)
                | Change::Forget(..)
                | Change::Fuse(..)
                | Change::InertialState(..)
                | Change::ImuFactor(..)
                | Change::ImuOffset(_)
                | Change::Readout(_)
                | Change::LeverArm(_)
                | Change::ScaleSigma(..)
                | Change::Calibrate(_)
                | Change::RemoveLandmark(_)
                | Change::Link(..)
                | Change::RelativePoses(..) => {}
            }
            then(self, change, removal);
        }
    }

    /// The version of the mirrored snapshot.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// A key frame, if it exists.
    pub fn key_frame(&self, id: KeyFrameId) -> Option<&Mirrored> {
        self.key_frames.get(&id)
    }

    /// All existing key frames in order of creation.
    pub fn key_frames(&self) -> impl Iterator<Item = (KeyFrameId, &Mirrored)> {
        self.key_frames.iter().map(|(id, k)| (*id, k))
    }

    /// The maps, oldest first, each with its prior relative to an earlier one.
    pub fn maps(&self) -> impl Iterator<Item = (MapId, Option<&MapPrior>)> {
        self.maps.iter().map(|(id, map_prior)| (*id, map_prior.as_ref()))
    }

    /// As [`Snapshot::world_from_here`].
    pub fn world_from_here(&self, id: KeyFrameId) -> Option<Sim3> {
        self.surviving_ancestor(id).map(|(k, relative)| k.world_from_here() * relative)
    }

    /// As [`Snapshot::surviving_ancestor`], with the key frame itself.
    pub fn surviving_ancestor(&self, id: KeyFrameId) -> Option<(&Mirrored, Sim3)> {
        let mut at = id;
        let mut relative = Sim3::identity();
        loop {
            if let Some(k) = self.key_frames.get(&at) {
                return Some((k, relative));
            }
            // Parents are older than their children, so this ends.
            let (parent, parent_from_it) = self.removed.get(&at).filter(|(parent, _)| *parent < at)?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
    }

    /// As [`Snapshot::resolve`].
    pub fn resolve(&self, id: KeyFrameId, camera_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.transform_pose(camera_from_it))
    }
}
