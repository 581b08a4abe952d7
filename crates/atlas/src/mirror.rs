//! A map's key frames without the map: kept up to date by the stream of changes alone.

use crate::{Change, KeyFrameId, Map, Published, Tie, WorldId};
use cairn_geometry::{Se3, Sim3};
use std::collections::BTreeMap;

/// A key frame as a listener knows it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mirrored {
    /// The world it stands in.
    pub world: WorldId,
    /// Where the eye was.
    pub world_from_eye: Se3,
    /// World units for one unit of what hangs on it.
    pub unit: f64,
}

impl Mirrored {
    /// The pose with the unit.
    pub fn world_from_here(&self) -> Sim3 {
        Sim3::new(self.world_from_eye.rotation, self.world_from_eye.translation, self.unit)
    }
}

/// Where all key frames are, in which world, and what hangs on whom.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mirror {
    version: u64,
    key_frames: BTreeMap<KeyFrameId, Mirrored>,
    gone: BTreeMap<KeyFrameId, (KeyFrameId, Sim3)>,
    worlds: BTreeMap<WorldId, Option<Tie>>,
}

impl Mirror {
    /// A mirror of one version of a map.
    pub fn of(map: &Map) -> Self {
        let mirrored =
            |k: &crate::KeyFrame| Mirrored { world: k.world, world_from_eye: k.world_from_eye, unit: k.unit };
        Self {
            version: map.version,
            key_frames: map.key_frames().map(|k| (k.id, mirrored(k))).collect(),
            gone: map.gone.iter().filter_map(|(i, g)| Some((KeyFrameId::from_index(i)?, *g))).collect(),
            worlds: map.worlds.as_ref().clone(),
        }
    }

    /// Takes up what one commit did; each must come once and in order.
    pub fn take(&mut self, published: &Published) {
        self.version = published.version;
        let mut removed = published.removed.iter();
        for change in &published.changes {
            match change {
                Change::AddKeyFrame(k) => {
                    let hung = k.parent.and_then(|p| self.key_frames.get(&p)).map(|p| p.world);
                    let world = hung.unwrap_or(WorldId(k.id));
                    if k.parent.is_none() {
                        self.worlds.insert(world, None);
                    }
                    let mirrored = Mirrored { world, world_from_eye: k.world_from_eye, unit: k.unit };
                    self.key_frames.insert(k.id, mirrored);
                }
                Change::MoveKeyFrame(id, pose) => {
                    if let Some(k) = self.key_frames.get_mut(id) {
                        k.world_from_eye = *pose;
                    }
                }
                Change::Scale(id, factor) => {
                    if let Some(k) = self.key_frames.get_mut(id) {
                        k.unit *= factor;
                    }
                }
                Change::Tie(world, tie) => {
                    self.worlds.insert(*world, Some(*tie));
                }
                Change::Merge { from, into, into_from, .. } => {
                    for k in self.key_frames.values_mut().filter(|k| k.world == *from) {
                        k.world = *into;
                        k.world_from_eye = into_from.transform_pose(&k.world_from_eye);
                        k.unit *= into_from.scale;
                    }
                    self.worlds.remove(from);
                }
                Change::Level(world, level_from_world) => {
                    for k in self.key_frames.values_mut().filter(|k| k.world == *world) {
                        k.world_from_eye = level_from_world.transform_pose(&k.world_from_eye);
                        k.unit *= level_from_world.scale;
                    }
                }
                Change::RemoveKeyFrame(id) => {
                    self.key_frames.remove(id);
                    if let Some(r) = removed.next() {
                        self.gone.insert(r.key_frame, (r.parent, r.parent_from_it));
                    }
                }
                Change::AddLandmark(..)
                | Change::MoveLandmark(..)
                | Change::Observe(..)
                | Change::Forget(..)
                | Change::Fuse(..)
                | Change::Motion(..)
                | Change::Felt(..)
                | Change::ImuOffset(_)
                | Change::Calibrate(_)
                | Change::RemoveLandmark(_)
                | Change::Link(..) => {}
            }
        }
    }

    /// The version of the map that it mirrors.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// A key frame, if it is alive.
    pub fn key_frame(&self, id: KeyFrameId) -> Option<&Mirrored> {
        self.key_frames.get(&id)
    }

    /// All living key frames in order of birth.
    pub fn key_frames(&self) -> impl Iterator<Item = (KeyFrameId, &Mirrored)> {
        self.key_frames.iter().map(|(id, k)| (*id, k))
    }

    /// The worlds, eldest first, each with how it hangs on a former one.
    pub fn worlds(&self) -> impl Iterator<Item = (WorldId, Option<&Tie>)> {
        self.worlds.iter().map(|(id, tie)| (*id, tie.as_ref()))
    }

    /// As [`Map::world_from_here`].
    pub fn world_from_here(&self, id: KeyFrameId) -> Option<Sim3> {
        let mut at = id;
        let mut relative = Sim3::identity();
        loop {
            if let Some(k) = self.key_frames.get(&at) {
                return Some(k.world_from_here() * relative);
            }
            // Parents are older than their children, so this ends.
            let (parent, parent_from_it) = self.gone.get(&at).filter(|(parent, _)| *parent < at)?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
    }

    /// As [`Map::stand`].
    pub fn stand(&self, id: KeyFrameId, eye_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.transform_pose(eye_from_it))
    }
}
