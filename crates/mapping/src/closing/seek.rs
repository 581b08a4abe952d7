//! Which earlier key frames may show the place that a key frame shows.

use crate::fuse::around;
use cairn_atlas::{KeyFrame, KeyFrameId, Map};
use cairn_geometry::Vec3;
use std::collections::BTreeSet;

/// Key frames that stand near and look the same way but are no neighbours, nearest first.
pub(super) fn candidates(map: &Map, here: &KeyFrame, reach: f64, limit: usize) -> Vec<KeyFrameId> {
    let mut known: BTreeSet<KeyFrameId> = around(map, here.id, 20).into_iter().collect();
    known.extend(here.covisible.iter().map(|(id, _)| *id));
    known.insert(here.id);
    let axis = |k: &KeyFrame| k.world_from_eye.rotation * Vec3::z();
    let mut near: Vec<(f64, KeyFrameId)> = map
        .key_frames_of(here.world)
        .filter(|k| !known.contains(&k.id) && axis(k).dot(&axis(here)) > 0.8)
        .map(|k| ((k.world_from_eye.translation - here.world_from_eye.translation).norm(), k.id))
        .filter(|(distance, _)| *distance < reach)
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().map(|(_, id)| id).take(limit).collect()
}
