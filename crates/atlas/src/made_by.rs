//! By what the key frames of each map were made: how many by the atlas's camera, how many by others with depth. Kept as key
//! frames come and go, because whether lengths in a map are metres is asked with every frame.

use crate::{KeyFrame, MapId};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The numbers, by map; maps without key frames have no entry.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct MadeBy(Arc<BTreeMap<MapId, Count>>);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Count {
    /// By the atlas's camera.
    own: usize,
    /// By others with depth.
    others_with_depth: usize,
    /// By others without.
    others: usize,
}

impl Count {
    fn of(&mut self, k: &KeyFrame) -> &mut usize {
        match &k.other_camera {
            None => &mut self.own,
            Some(other) if other.camera.has_depth() => &mut self.others_with_depth,
            Some(_) => &mut self.others,
        }
    }
}

impl MadeBy {
    /// Counts these key frames.
    pub fn of<'a>(key_frames: impl Iterator<Item = &'a KeyFrame>) -> Self {
        let mut made_by = Self::default();
        key_frames.for_each(|k| made_by.add(k));
        made_by
    }

    /// Counts a key frame that was added.
    pub fn add(&mut self, k: &KeyFrame) {
        *Arc::make_mut(&mut self.0).entry(k.map).or_default().of(k) += 1;
    }

    /// Counts a key frame no longer.
    pub fn remove(&mut self, k: &KeyFrame) {
        let maps = Arc::make_mut(&mut self.0);
        let Some(count) = maps.get_mut(&k.map) else { return };
        let of_its_kind = count.of(k);
        *of_its_kind = of_its_kind.saturating_sub(1);
        if *count == Count::default() {
            maps.remove(&k.map);
        }
    }

    /// Counts the key frames of one map for another.
    pub fn merge(&mut self, from: MapId, into: MapId) {
        let maps = Arc::make_mut(&mut self.0);
        let Some(moved) = maps.remove(&from) else { return };
        let count = maps.entry(into).or_default();
        count.own += moved.own;
        count.others_with_depth += moved.others_with_depth;
        count.others += moved.others;
    }

    /// Whether a key frame of a map has depth; `camera` is the atlas's.
    pub fn has_depth(&self, map: MapId, camera: &RectifiedCamera) -> bool {
        let count = self.0.get(&map).copied().unwrap_or_default();
        count.others_with_depth > 0 || count.own > 0 && camera.has_depth()
    }
}
