//! Snapshots: all key frames and landmarks of an atlas at one version, in one map or several.

use crate::arena::Arena;
use crate::made_by::MadeBy;
use crate::names::Names;
use crate::paged::{Faults, ReadBackError};
use crate::{
    KeyFrame, KeyFrameId, Landmark, LandmarkId, MapId, MapPrior, OtherCamera, PlaceIndex, RelativePose,
};
use cairn_geometry::{Se3, Sim3};
use cairn_vision::Octaves;
use std::collections::BTreeMap;
use std::sync::Arc;

/// One immutable version of the atlas. Cloning is cheap; see [`Snapshot::apply`] for the next version.
#[derive(Clone, Debug)]
pub struct Snapshot {
    pub(crate) version: u64,
    pub(crate) octaves: Octaves,
    pub(crate) key_frames: Arena<KeyFrame>,
    pub(crate) landmarks: Arena<Landmark>,
    /// For each removed key frame, its parent and its pose there.
    pub(crate) removed: Arena<(KeyFrameId, Sim3)>,
    pub(crate) maps: Arc<BTreeMap<MapId, Option<MapPrior>>>,
    /// How often each map was gravity-aligned; maps that never were have no entry.
    pub(crate) gravity_alignments: Arc<BTreeMap<MapId, u32>>,
    /// How often the unit of length of each map was changed.
    pub(crate) rescalings: Arc<BTreeMap<MapId, u32>>,
    /// Standard deviations of the logarithm of scale that were stated for maps.
    pub(crate) scale_sigmas: Arc<BTreeMap<MapId, f64>>,
    pub(crate) places: PlaceIndex,
    pub(crate) names: Arc<Names>,
    pub(crate) other_cameras: Arc<Vec<Arc<OtherCamera>>>,
    pub(crate) made_by: MadeBy,
    pub(crate) right_offset: f64,
    pub(crate) imu_offset: f64,
    pub(crate) imu_from_camera: Option<Se3>,
    pub(crate) readout: Readout,
    pub(crate) next_key_frame: usize,
    pub(crate) next_landmark: usize,
    pub(crate) faults: Faults,
}

impl Default for Snapshot {
    fn default() -> Self {
        Self::new()
    }
}

/// The readout time of a camera's rows (rolling shutter).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Readout {
    /// Seconds from the exposure of the first row to that of the last; negative where the last row is first.
    pub seconds: f64,
    /// Its standard deviation.
    pub sigma_s: f64,
}

impl Readout {
    /// Its greatest size, seconds: that of an image at 20 a second.
    pub const MOST_S: f64 = 0.05;

    /// Whether the rows are known to be read one after the other: phones take 10 ms and more (`phone/b` 20 to 32), and what is found of a
    /// global shutter should be less than its deviation.
    pub fn is_rolling(&self) -> bool {
        self.seconds.abs() > 0.004_f64.max(self.sigma_s)
    }

    pub(crate) fn is_sound(&self) -> bool {
        self.seconds.abs() <= Self::MOST_S && self.sigma_s > 0.0 && self.sigma_s.is_finite()
    }
}

impl Default for Readout {
    /// Before anything was seen: cameras take up to 30 ms, from either end.
    fn default() -> Self {
        Self { seconds: 0.0, sigma_s: 0.02 }
    }
}

/// An invariant of a snapshot that does not hold, in words.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct Unsound(String);

impl Snapshot {
    /// An empty snapshot for the usual eight octaves of 1.2.
    pub fn new() -> Self {
        Self::with_octaves(Octaves { levels: 8, factor: 1.2 })
    }

    /// An empty snapshot whose key frames have these octaves.
    pub fn with_octaves(octaves: Octaves) -> Self {
        Self {
            version: 0,
            octaves,
            key_frames: Arena::default(),
            landmarks: Arena::default(),
            removed: Arena::default(),
            maps: Arc::default(),
            gravity_alignments: Arc::default(),
            rescalings: Arc::default(),
            scale_sigmas: Arc::default(),
            places: PlaceIndex::default(),
            names: Arc::default(),
            other_cameras: Arc::default(),
            made_by: MadeBy::default(),
            right_offset: 0.0,
            imu_offset: 0.0,
            imu_from_camera: None,
            readout: Readout::default(),
            next_key_frame: 0,
            next_landmark: 0,
            faults: Faults::default(),
        }
    }

    /// The version, counted from 0.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// The scale pyramid of all key frames.
    pub fn octaves(&self) -> Octaves {
        self.octaves
    }

    /// Disparity correction in pixels, to be added to every measured right x, as estimated by mapping: the
    /// constant part of a stereo calibration's error.
    pub fn right_offset(&self) -> f64 {
        self.right_offset
    }

    /// Time offset: seconds to be added to the stamps of the IMU, beyond what its source adds, to get the
    /// images' clock: `t_imu + offset = t_image`. Zero until it is estimated, and in a map that was loaded.
    pub fn imu_offset(&self) -> f64 {
        self.imu_offset
    }

    /// The readout time of the camera's rows, as estimated by mapping. Unknown in a map that was loaded.
    pub fn readout(&self) -> Readout {
        self.readout
    }

    /// The existing key frames by their words.
    pub fn places(&self) -> &PlaceIndex {
        &self.places
    }

    /// A key frame, if it exists.
    pub fn key_frame(&self, id: KeyFrameId) -> Option<&KeyFrame> {
        self.key_frames.get(id.index())
    }

    /// A landmark, if it exists.
    pub fn landmark(&self, id: LandmarkId) -> Option<&Landmark> {
        self.landmarks.get(id.index())
    }

    /// All key frames in order of creation.
    pub fn key_frames(&self) -> impl Iterator<Item = &KeyFrame> {
        self.key_frames.iter().map(|(_, k)| k)
    }

    /// The key frames from an id on, in order of creation.
    pub fn key_frames_from(&self, id: KeyFrameId) -> impl Iterator<Item = &KeyFrame> {
        (id.index()..self.next_key_frame).filter_map(|i| self.key_frames.get(i))
    }

    /// All landmarks in order of creation.
    pub fn landmarks(&self) -> impl Iterator<Item = &Landmark> {
        self.landmarks.iter().map(|(_, l)| l)
    }

    /// The maps, oldest first, each with its prior relative to an earlier one.
    pub fn maps(&self) -> impl Iterator<Item = (MapId, Option<&MapPrior>)> {
        self.maps.iter().map(|(id, map_prior)| (*id, map_prior.as_ref()))
    }

    /// Whether a map is gravity-aligned by the IMU: its lengths are metres and its z axis points up.
    pub fn is_gravity_aligned(&self, map: MapId) -> bool {
        self.gravity_alignments.contains_key(&map)
    }

    /// Whether there are maps, and every one is gravity-aligned.
    pub fn is_gravity_aligned_throughout(&self) -> bool {
        let mut maps = self.maps().map(|(w, _)| self.is_gravity_aligned(w)).peekable();
        maps.peek().is_some() && maps.all(|aligned| aligned)
    }

    /// The key frames of one map in order of creation.
    pub fn key_frames_of(&self, map: MapId) -> impl Iterator<Item = &KeyFrame> {
        self.key_frames().filter(move |k| k.map == map)
    }

    /// The newest existing key frame.
    pub fn newest_key_frame(&self) -> Option<&KeyFrame> {
        (0..self.next_key_frame).rev().find_map(|i| self.key_frames.get(i))
    }

    /// The number of existing key frames.
    pub fn key_frame_count(&self) -> usize {
        self.key_frames.len()
    }

    /// The number of removed key frames; what was anchored to them is anchored to others.
    pub fn removed_key_frame_count(&self) -> usize {
        self.removed.len()
    }

    /// The number of existing landmarks.
    pub fn landmark_count(&self) -> usize {
        self.landmarks.len()
    }

    /// The id that the next new key frame must have.
    pub fn next_key_frame_id(&self) -> KeyFrameId {
        KeyFrameId::from_index(self.next_key_frame).expect("fewer than four billion key frames")
    }

    /// The id that the next new landmark must have; further new ones count on from it.
    pub fn next_landmark_id(&self) -> LandmarkId {
        LandmarkId::from_index(self.next_landmark).expect("fewer than four billion landmarks")
    }

    /// Pose and unit of a key frame, also of a removed one: that follows its parent.
    pub fn world_from_here(&self, id: KeyFrameId) -> Option<Sim3> {
        let (ancestor, ancestor_from_id) = self.surviving_ancestor(id)?;
        Some(self.key_frame(ancestor)?.world_from_here() * ancestor_from_id)
    }

    /// The pose alone of [`Snapshot::world_from_here`].
    pub fn world_from_camera(&self, id: KeyFrameId) -> Option<Se3> {
        self.world_from_here(id).map(|here| Se3::new(here.rotation, here.translation))
    }

    /// The existing key frame that `id` is anchored to now, with `ancestor_from_id`.
    pub fn surviving_ancestor(&self, id: KeyFrameId) -> Option<(KeyFrameId, Sim3)> {
        let mut at = id;
        let mut relative = Sim3::identity();
        while self.key_frame(at).is_none() {
            let (parent, parent_from_it) = self.removed.get(at.index())?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
        Some((at, relative))
    }

    /// The pose of something anchored to a key frame with `camera_from_it`.
    pub fn resolve(&self, id: KeyFrameId, camera_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.transform_pose(camera_from_it))
    }

    /// Anchors a pose `world_from_it` to a key frame: the `camera_from_it` that follows the map from now on.
    pub fn anchor(&self, id: KeyFrameId, world_from_it: &Se3) -> Option<Se3> {
        Some(self.world_from_here(id)?.inverse().transform_pose(world_from_it))
    }

    /// Key frames that observe any of these landmarks, with how many of them, most first.
    pub fn votes<'a>(&self, landmarks: impl IntoIterator<Item = &'a LandmarkId>) -> Vec<(KeyFrameId, u32)> {
        let seen = landmarks.into_iter().filter_map(|id| self.landmark(*id)).flat_map(|l| &l.observations);
        let seen: Vec<usize> = seen.map(|o| o.key_frame.index()).collect();
        // Those that see the same are neighbours: counts between the first and the last, not for the whole map.
        let (first, last) =
            (seen.iter().min().copied().unwrap_or(0), seen.iter().max().copied().unwrap_or(0));
        let mut counts = vec![0u32; last - first + 1];
        seen.iter().for_each(|index| counts[index - first] += 1);
        let counted = counts.iter().enumerate().filter(|(_, n)| **n > 0);
        let mut votes: Vec<(KeyFrameId, u32)> =
            counted.filter_map(|(i, n)| Some((KeyFrameId::from_index(first + i)?, *n))).collect();
        votes.sort_unstable_by_key(|(id, n)| (std::cmp::Reverse(*n), *id));
        votes
    }

    /// What went wrong first when features or words of a key frame were read back from the disk. Such a key frame matches
    /// nothing any more, and the map cannot be saved.
    pub fn read_fault(&self) -> Option<&ReadBackError> {
        self.faults.first()
    }

    /// Checks the invariants, for tests and `map check`.
    ///
    /// # Errors
    /// [`Unsound`] with the first violation.
    pub fn check(&self) -> Result<(), Unsound> {
        self.check_observations()?;
        self.check_key_frames()
    }

    /// What key frames say of each other, and of their features.
    pub(crate) fn check_key_frames(&self) -> Result<(), Unsound> {
        for k in self.key_frames() {
            // What is on disk was checked when it was written, or is when it is read.
            if k.frame.in_memory().is_some_and(|frame| k.landmarks.len() != frame.len()) {
                let (slots, features) = (k.landmarks.len(), k.frame.len());
                return Err(Unsound(format!(
                    "{:?} has {slots} landmark slots for {features} features",
                    k.id
                )));
            }
            match k.parent {
                Some(p) if p >= k.id => {
                    return Err(Unsound(format!("{:?} has the younger parent {p:?}", k.id)));
                }
                Some(p) if self.key_frame(p).is_none_or(|p| p.map != k.map) => {
                    return Err(Unsound(format!("{:?} has the parent {p:?}, which is not in its map", k.id)));
                }
                None if k.map.root() != k.id || !self.maps.contains_key(&k.map) => {
                    return Err(Unsound(format!("{:?} is the root of no map", k.id)));
                }
                _ => {}
            }
            if !(k.unit.is_finite() && k.unit > 0.0) {
                return Err(Unsound(format!("{:?} has the unit {}", k.id, k.unit)));
            }
            if let Some(other) = k.links.iter().find(|other| {
                self.key_frame(**other).is_none_or(|o| o.map != k.map || !o.links.contains(&k.id))
            }) {
                return Err(Unsound(format!("{:?} has a loop with {other:?}, which does not list it", k.id)));
            }
        }
        self.check_relative_poses()?;
        if self.made_by != MadeBy::of(self.key_frames()) {
            return Err(Unsound("the key frames of a map are counted wrongly".into()));
        }
        for map in self.maps.keys() {
            if self.key_frame(map.root()).is_none_or(|k| k.parent.is_some()) {
                return Err(Unsound(format!("{map:?} has no root")));
            }
        }
        Ok(())
    }

    fn check_relative_poses(&self) -> Result<(), Unsound> {
        for k in self.key_frames() {
            let all = &k.relative_poses;
            let of_map = |z: &RelativePose| {
                z.from < k.id && self.key_frame(z.from).is_some_and(|from| from.map == k.map)
            };
            let ordered = all.is_sorted_by(|a, b| a.from < b.from);
            if !ordered || !all.iter().all(|z| of_map(z) && z.is_sound()) {
                return Err(Unsound(format!("{:?} has an invalid pose relative to another key frame", k.id)));
            }
        }
        Ok(())
    }

    /// What key frames and landmarks say of each other.
    fn check_observations(&self) -> Result<(), Unsound> {
        for k in self.key_frames() {
            for (i, id) in k.landmarks.iter().enumerate() {
                let Some(id) = id else { continue };
                let Some(l) = self.landmark(*id) else {
                    return Err(Unsound(format!("{:?} shows {id:?}, which does not exist", k.id)));
                };
                if l.feature_in(k.id) != Some(i as u16) {
                    let why =
                        format!("{:?} shows {id:?} in feature {i}, but the landmark does not list it", k.id);
                    return Err(Unsound(why));
                }
            }
        }
        for l in self.landmarks() {
            if l.observations.is_empty() {
                return Err(Unsound(format!("{:?} has no observations", l.id)));
            }
            let map = |o: &crate::Observation| self.key_frame(o.key_frame).map(|k| k.map);
            if l.observations.iter().any(|o| map(o) != map(&l.observations[0])) {
                return Err(Unsound(format!("{:?} is observed from two maps", l.id)));
            }
            for o in &l.observations {
                let shown =
                    self.key_frame(o.key_frame).and_then(|k| k.landmarks.get(o.feature as usize).copied());
                if shown != Some(Some(l.id)) {
                    let why = format!("{:?} is observed in {o:?}, but the key frame does not list it", l.id);
                    return Err(Unsound(why));
                }
            }
        }
        Ok(())
    }
}
