//! The map: key frames and landmarks of all that was ever seen, in one world or several.

use crate::arena::Arena;
use crate::{KeyFrame, KeyFrameId, Landmark, LandmarkId, MapId, MapPrior, PlaceIndex};
use cairn_geometry::{Se3, Sim3};
use cairn_vision::{Octaves, RectifiedCamera};
use std::collections::BTreeMap;
use std::sync::Arc;

/// A version of the map. Cloning is cheap; see [`Snapshot::apply`] for the next version.
#[derive(Clone, Debug)]
pub struct Snapshot {
    pub(crate) version: u64,
    pub(crate) octaves: Octaves,
    pub(crate) key_frames: Arena<KeyFrame>,
    pub(crate) landmarks: Arena<Landmark>,
    /// For each removed key frame, the one it hangs on and where it stood there.
    pub(crate) gone: Arena<(KeyFrameId, Sim3)>,
    pub(crate) maps: Arc<BTreeMap<MapId, Option<MapPrior>>>,
    /// How often each world was levelled; those that are not there never were.
    pub(crate) gravity_alignments: Arc<BTreeMap<MapId, u32>>,
    /// How often the unit of length of each map was changed.
    pub(crate) rescalings: Arc<BTreeMap<MapId, u32>>,
    pub(crate) places: PlaceIndex,
    pub(crate) right_offset: f64,
    pub(crate) imu_offset: f64,
    pub(crate) next_key_frame: usize,
    pub(crate) next_landmark: usize,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self::new()
    }
}

impl Snapshot {
    /// An empty map for the usual eight octaves of 1.2.
    pub fn new() -> Self {
        Self::with_octaves(Octaves { levels: 8, factor: 1.2 })
    }

    /// An empty map whose key frames have these octaves.
    pub fn with_octaves(octaves: Octaves) -> Self {
        Self {
            version: 0,
            octaves,
            key_frames: Arena::default(),
            landmarks: Arena::default(),
            gone: Arena::default(),
            maps: Arc::default(),
            gravity_alignments: Arc::default(),
            rescalings: Arc::default(),
            places: PlaceIndex::default(),
            right_offset: 0.0,
            imu_offset: 0.0,
            next_key_frame: 0,
            next_landmark: 0,
        }
    }

    /// Which version this is, counted from 0.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// The scale pyramid of all key frames.
    pub fn octaves(&self) -> Octaves {
        self.octaves
    }

    /// What is to be added to every measured right x, pixels, as the map has found it: the part of a stereo
    /// calibration's error that looks like disparity.
    pub fn right_offset(&self) -> f64 {
        self.right_offset
    }

    /// Seconds to be added to the stamps of the inertial sensor, beyond what its source adds, to get the images' clock:
    /// `t_imu + offset = t_image`. Zero until it is found, and in a map that was opened.
    pub fn imu_offset(&self) -> f64 {
        self.imu_offset
    }

    /// The living key frames by the words that they show.
    pub fn places(&self) -> &PlaceIndex {
        &self.places
    }

    /// A key frame, if it is alive.
    pub fn key_frame(&self, id: KeyFrameId) -> Option<&KeyFrame> {
        self.key_frames.get(id.index())
    }

    /// A landmark, if it is alive.
    pub fn landmark(&self, id: LandmarkId) -> Option<&Landmark> {
        self.landmarks.get(id.index())
    }

    /// All key frames in order of birth.
    pub fn key_frames(&self) -> impl Iterator<Item = &KeyFrame> {
        self.key_frames.iter().map(|(_, k)| k)
    }

    /// All landmarks in order of birth.
    pub fn landmarks(&self) -> impl Iterator<Item = &Landmark> {
        self.landmarks.iter().map(|(_, l)| l)
    }

    /// The worlds, eldest first, each with how it hangs on a former one.
    pub fn maps(&self) -> impl Iterator<Item = (MapId, Option<&MapPrior>)> {
        self.maps.iter().map(|(id, tie)| (*id, tie.as_ref()))
    }

    /// True when lengths in a world are metres and its z axis points up, as an inertial sensor has found.
    pub fn is_gravity_aligned(&self, map: MapId) -> bool {
        self.gravity_alignments.contains_key(&map)
    }

    /// Whether lengths in one world are metres.
    pub fn is_metric_in(&self, map: MapId, camera: &RectifiedCamera) -> bool {
        camera.has_depth() || self.is_gravity_aligned(map)
    }

    /// Whether lengths in the whole map are metres: the eye has depth, or the inertial sensor has told in each world.
    pub fn is_metric(&self, camera: &RectifiedCamera) -> bool {
        camera.has_depth() || self.is_gravity_aligned_throughout()
    }

    /// True when there are worlds, and the z axis of each points up.
    pub fn is_gravity_aligned_throughout(&self) -> bool {
        let mut maps = self.maps().map(|(w, _)| self.is_gravity_aligned(w)).peekable();
        maps.peek().is_some() && maps.all(|level| level)
    }

    /// The key frames of one world in order of birth.
    pub fn key_frames_of(&self, map: MapId) -> impl Iterator<Item = &KeyFrame> {
        self.key_frames().filter(move |k| k.map == map)
    }

    /// The youngest living key frame.
    pub fn newest_key_frame(&self) -> Option<&KeyFrame> {
        (0..self.next_key_frame).rev().find_map(|i| self.key_frames.get(i))
    }

    /// How many key frames are alive.
    pub fn key_frame_count(&self) -> usize {
        self.key_frames.len()
    }

    /// How many key frames were removed; what hung on them hangs on others.
    pub fn removed_key_frame_count(&self) -> usize {
        self.gone.len()
    }

    /// How many landmarks are alive.
    pub fn landmark_count(&self) -> usize {
        self.landmarks.len()
    }

    /// The id that the next new key frame shall have.
    pub fn next_key_frame_id(&self) -> KeyFrameId {
        KeyFrameId::from_index(self.next_key_frame).expect("fewer than four billion key frames")
    }

    /// The id that the next new landmark shall have; further new ones count on from it.
    pub fn next_landmark_id(&self) -> LandmarkId {
        LandmarkId::from_index(self.next_landmark).expect("fewer than four billion landmarks")
    }

    /// Where the eye of a key frame stands and the unit of what hangs on it, also for one that was removed: it stands
    /// where its parent puts it.
    pub fn world_from_here(&self, id: KeyFrameId) -> Option<Sim3> {
        let (surviving_ancestor, living_from_id) = self.surviving_ancestor(id)?;
        Some(self.key_frame(surviving_ancestor)?.world_from_here() * living_from_id)
    }

    /// The pose alone of [`Snapshot::world_from_here`].
    pub fn world_from_camera(&self, id: KeyFrameId) -> Option<Se3> {
        self.world_from_here(id).map(|here| Se3::new(here.rotation, here.translation))
    }

    /// The living key frame that what hangs on `id` hangs on now, with `living_from_id`.
    pub fn surviving_ancestor(&self, id: KeyFrameId) -> Option<(KeyFrameId, Sim3)> {
        let mut at = id;
        let mut relative = Sim3::identity();
        while self.key_frame(at).is_none() {
            let (parent, parent_from_it) = self.gone.get(at.index())?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
        Some((at, relative))
    }

    /// Where something stands that hangs on a key frame with `camera_from_it`.
    pub fn resolve(&self, id: KeyFrameId, camera_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.transform_pose(camera_from_it))
    }

    /// How something hangs on a key frame that stands at `world_from_it` in its world: the `camera_from_it` that follows
    /// the map from now on.
    pub fn anchor(&self, id: KeyFrameId, world_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.inverse().transform_pose(world_from_it))
    }

    /// Key frames that see any of these landmarks, with how many of them each sees, most first.
    pub fn votes<'a>(&self, landmarks: impl IntoIterator<Item = &'a LandmarkId>) -> Vec<(KeyFrameId, u32)> {
        let mut seen: Vec<KeyFrameId> = Vec::new();
        for landmark in landmarks.into_iter().filter_map(|id| self.landmark(*id)) {
            seen.extend(landmark.observations.iter().map(|o| o.key_frame));
        }
        seen.sort_unstable();
        let mut votes: Vec<(KeyFrameId, u32)> =
            seen.chunk_by(|a, b| a == b).map(|same| (same[0], same.len() as u32)).collect();
        votes.sort_by_key(|(id, n)| (std::cmp::Reverse(*n), *id));
        votes
    }

    /// Checks what must always hold; the first breach in words. For tests and `map check`.
    pub fn check(&self) -> Result<(), String> {
        for k in self.key_frames() {
            if k.landmarks.len() != k.frame.len() {
                return Err(format!(
                    "{:?} has {} landmark slots for {} features",
                    k.id,
                    k.landmarks.len(),
                    k.frame.len()
                ));
            }
            for (i, id) in k.landmarks.iter().enumerate() {
                let Some(id) = id else { continue };
                let Some(l) = self.landmark(*id) else {
                    return Err(format!("{:?} shows {id:?}, which is gone", k.id));
                };
                if l.feature_in(k.id) != Some(i as u16) {
                    return Err(format!(
                        "{:?} shows {id:?} in feature {i}, the landmark does not know",
                        k.id
                    ));
                }
            }
            match k.parent {
                Some(p) if p >= k.id => return Err(format!("{:?} has the younger parent {p:?}", k.id)),
                Some(p) if self.key_frame(p).is_none_or(|p| p.map != k.map) => {
                    return Err(format!("{:?} has the parent {p:?}, which is not in its world", k.id));
                }
                None if k.map.root() != k.id || !self.maps.contains_key(&k.map) => {
                    return Err(format!("{:?} is the root of no world", k.id));
                }
                _ => {}
            }
            if !(k.unit.is_finite() && k.unit > 0.0) {
                return Err(format!("{:?} has the unit {}", k.id, k.unit));
            }
            if let Some(other) = k.links.iter().find(|other| {
                self.key_frame(**other).is_none_or(|o| o.map != k.map || !o.links.contains(&k.id))
            }) {
                return Err(format!("{:?} has a loop with {other:?}, which does not know", k.id));
            }
        }
        for map in self.maps.keys() {
            if self.key_frame(map.root()).is_none_or(|k| k.parent.is_some()) {
                return Err(format!("{map:?} has no root"));
            }
        }
        for l in self.landmarks() {
            if l.observations.is_empty() {
                return Err(format!("{:?} is seen by nobody", l.id));
            }
            let map = |o: &crate::Observation| self.key_frame(o.key_frame).map(|k| k.map);
            if l.observations.iter().any(|o| map(o) != map(&l.observations[0])) {
                return Err(format!("{:?} is seen from two worlds", l.id));
            }
            for o in &l.observations {
                let shown =
                    self.key_frame(o.key_frame).and_then(|k| k.landmarks.get(o.feature as usize).copied());
                if shown != Some(Some(l.id)) {
                    return Err(format!("{:?} is observed in {o:?}, the key frame does not know", l.id));
                }
            }
        }
        Ok(())
    }
}
