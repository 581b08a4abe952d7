//! Poses of key frames relative to each other by the depth that both have of one surface, for adjustments of whole maps.
//!
//! In: the depth images of key frames, and a map. Out: the changes that give its key frames [`RelativePose`]s, between pairs that look at one
//! surface, near in time or not, whether they share landmarks or none. The map keeps them: it is saved with them, and other programs that join
//! or adjust it need no images. Each comes from a point-to-surface alignment with its covariance (`cairn_dense::track`);
//! directions that the surface leaves free carry no information.
//!
//! Images are kept small: 3,000 points tell a pose to a millimetre or two, and a map has many key frames. Which images there are when a map is
//! adjusted, and what was aligned before, depends on the key frames and the order of the adjustments alone, so that a replay finds the same.

mod align;
mod pairs;
#[cfg(test)]
mod tests;
mod view;

use align::Aligner;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, RelativePose, Snapshot};
use cairn_geometry::Se3;
use cairn_sensor::{DepthImage, DepthSensor, Stamp};
use pairs::pairs;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use view::{Shrink, View};

/// Images of frames that wait to become key frames, at most; the oldest are dropped.
const MOST_OFFERED: usize = 48;

/// The depth of key frames. The engine offers it, mapping keeps that of key frames, and adjustments of whole maps align it: clones share it.
#[derive(Clone, Debug)]
pub struct DepthViews(Arc<Shared>);

#[derive(Debug)]
struct Shared {
    shrink: Shrink,
    metres_per_unit: f64,
    camera_from_depth: Se3,
    kept: Mutex<Kept>,
    /// Held as long as a map is aligned: mapping does not wait for that.
    aligner: Mutex<Aligner>,
    /// The first key frame whose pose is that of its depth: poses that stay where depth put them are not aligned again.
    held: OnceLock<KeyFrameId>,
}

#[derive(Debug, Default)]
struct Kept {
    offered: BTreeMap<Stamp, Arc<DepthImage>>,
    views: BTreeMap<KeyFrameId, Arc<View>>,
}

impl DepthViews {
    /// For a depth sensor mounted at `camera_from_depth` on the camera whose poses key frames have (metres); `None` for a sensor
    /// that cannot be used.
    pub fn new(sensor: &DepthSensor, camera_from_depth: Se3) -> Option<Self> {
        let shrink = Shrink::of(&sensor.camera);
        let aligner = Aligner::new(shrink.camera, sensor.metres_per_unit, camera_from_depth)?;
        Some(Self(Arc::new(Shared {
            shrink,
            metres_per_unit: sensor.metres_per_unit,
            camera_from_depth,
            kept: Mutex::default(),
            aligner: Mutex::new(aligner),
            held: OnceLock::new(),
        })))
    }

    /// Poses are those of the depth, from this key frame on.
    pub(crate) fn hold_from(&self, id: KeyFrameId) {
        let _ = self.0.held.set(id);
    }

    /// Whether the pose of a key frame is that of its depth.
    pub(crate) fn is_held(&self, id: KeyFrameId) -> bool {
        self.0.held.get().is_some_and(|first| id >= *first)
    }

    /// Takes the depth of a frame that may become a key frame.
    pub fn offer(&self, stamp: Stamp, depth: Arc<DepthImage>) {
        let mut kept = self.kept();
        kept.offered.insert(stamp, depth);
        if kept.offered.len() > MOST_OFFERED {
            kept.offered.pop_first();
        }
    }

    /// The frame of this stamp is this key frame now; those before it will be none.
    pub(crate) fn keep(&self, id: KeyFrameId, stamp: Stamp) {
        let mut kept = self.kept();
        let later = kept.offered.split_off(&stamp);
        kept.offered = later;
        let Some(depth) = kept.offered.remove(&stamp) else { return };
        drop(kept);
        let Some(view) = self.0.shrink.view(&depth, self.0.metres_per_unit) else { return };
        self.kept().views.insert(id, Arc::new(view));
    }

    /// Drops the images of key frames that are no more. Called with the snapshots of closing, one after the other.
    pub(crate) fn drop_removed(&self, snapshot: &Snapshot) {
        let next = snapshot.next_key_frame_id();
        self.kept().views.retain(|id, _| *id >= next || snapshot.key_frame(*id).is_some());
    }

    /// The changes that give a map's key frames their relative poses. `stop` is asked between alignments; once it has returned true, they are
    /// those so far. What was aligned before and agrees with the map is not aligned again; what is known of key frames whose depth is not
    /// here, since they are of a map that was loaded, stays.
    pub(crate) fn measure(
        &self,
        snapshot: &Snapshot,
        map: MapId,
        stop: &mut dyn FnMut() -> bool,
    ) -> Vec<Change> {
        let views = self.kept().views.clone();
        let pairs = pairs(snapshot, map, &views, &self.0.shrink, &self.0.camera_from_depth);
        let mut measured: BTreeMap<KeyFrameId, Vec<RelativePose>> = BTreeMap::new();
        for (id, z) in self.aligner().align(snapshot, &views, &pairs, stop) {
            measured.entry(id).or_default().push(z);
        }
        let change = |k: &KeyFrame| {
            let stays = |z: &&RelativePose| !(views.contains_key(&k.id) && views.contains_key(&z.from));
            let mut all: Vec<RelativePose> = k.relative_poses.iter().filter(stays).copied().collect();
            all.extend(measured.remove(&k.id).into_iter().flatten());
            all.sort_by_key(|z| z.from);
            (all != k.relative_poses).then_some(Change::RelativePoses(k.id, all))
        };
        snapshot.key_frames_of(map).filter_map(change).collect()
    }

    fn kept(&self) -> MutexGuard<'_, Kept> {
        self.0.kept.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn aligner(&self) -> MutexGuard<'_, Aligner> {
        self.0.aligner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
