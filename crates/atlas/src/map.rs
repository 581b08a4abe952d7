//! The map: key frames and landmarks of one connected piece of the world.

use crate::arena::Arena;
use crate::{KeyFrame, KeyFrameId, Landmark, LandmarkId};
use cairn_geometry::Se3;
use cairn_vision::Octaves;

/// A version of the map. Cloning is cheap; see [`Map::apply`] for the next version.
#[derive(Clone, Debug)]
pub struct Map {
    pub(crate) version: u64,
    pub(crate) octaves: Octaves,
    pub(crate) key_frames: Arena<KeyFrame>,
    pub(crate) landmarks: Arena<Landmark>,
    /// For each removed key frame, the one it hangs on and where it stood there.
    pub(crate) gone: Arena<(KeyFrameId, Se3)>,
    pub(crate) right_offset: f64,
    pub(crate) next_key_frame: usize,
    pub(crate) next_landmark: usize,
}

impl Default for Map {
    fn default() -> Self {
        Self::new()
    }
}

impl Map {
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
            right_offset: 0.0,
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

    /// The youngest living key frame.
    pub fn newest_key_frame(&self) -> Option<&KeyFrame> {
        (0..self.next_key_frame).rev().find_map(|i| self.key_frames.get(i))
    }

    /// How many key frames are alive.
    pub fn key_frame_count(&self) -> usize {
        self.key_frames.len()
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

    /// Where the eye of a key frame stands, also for one that was removed: it stands where its parent puts it.
    pub fn world_from_eye(&self, id: KeyFrameId) -> Option<Se3> {
        let mut at = id;
        let mut relative = Se3::identity();
        loop {
            if let Some(k) = self.key_frame(at) {
                return Some(k.world_from_eye * relative);
            }
            let (parent, parent_from_it) = self.gone.get(at.index())?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
    }

    /// The living key frame that what hangs on `id` hangs on now, with `living_from_id`.
    pub fn living(&self, id: KeyFrameId) -> Option<(KeyFrameId, Se3)> {
        let mut at = id;
        let mut relative = Se3::identity();
        while self.key_frame(at).is_none() {
            let (parent, parent_from_it) = self.gone.get(at.index())?;
            relative = *parent_from_it * relative;
            at = *parent;
        }
        Some((at, relative))
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
            if let Some(p) = k.parent
                && self.key_frame(p).is_none()
            {
                return Err(format!("{:?} has the parent {p:?}, which is gone", k.id));
            }
        }
        for l in self.landmarks() {
            if l.observations.is_empty() {
                return Err(format!("{:?} is seen by nobody", l.id));
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
