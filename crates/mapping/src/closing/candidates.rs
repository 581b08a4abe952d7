//! Candidates for a place recognition: earlier key frames that may show the same place as a key frame.

use crate::fuse::around;
use cairn_atlas::{KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// Smallest bag-of-words similarity of a candidate, as a share of that of the best neighbour.
const MIN_SIMILARITY: f64 = 0.3;

/// Key frames that are no neighbours and may show the same place: first those nearby that face the same way,
/// then those of any map that are most similar by bag of words, one of each group of neighbours. Key frames with depth have no place in
/// a map without metres.
pub(super) fn candidates(
    snapshot: &Snapshot,
    atlas: &RectifiedCamera,
    here: &KeyFrame,
    reach: f64,
    limit: usize,
) -> Vec<KeyFrameId> {
    let mut known: BTreeSet<KeyFrameId> = around(snapshot, here.id, 20).into_iter().collect();
    known.extend(here.covisible.iter().map(|(id, _)| *id));
    known.insert(here.id);
    let axis = |k: &KeyFrame| k.world_from_camera.rotation * Vec3::z();
    let mut near: Vec<(f64, KeyFrameId)> = snapshot
        .key_frames_of(here.map)
        .filter(|k| !known.contains(&k.id) && axis(k).dot(&axis(here)) > 0.8)
        .map(|k| ((k.world_from_camera.translation - here.world_from_camera.translation).norm(), k.id))
        .filter(|(distance, _)| *distance < reach)
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let mut found: Vec<KeyFrameId> = near.into_iter().map(|(_, id)| id).take(limit.div_ceil(2)).collect();
    let neighbours = here.covisible.iter().take(5).filter_map(|(id, _)| snapshot.key_frame(*id));
    let usual = neighbours.map(|k| k.bag.similarity(&here.bag)).fold(0.0, f64::max);
    let (left, all) = (limit.saturating_sub(found.len()), usize::MAX);
    let with_depth = here.camera(atlas).has_depth();
    let fits = |k: &KeyFrame| !with_depth || snapshot.is_metric_in(k.map, atlas);
    let may_show = |id| !known.contains(&id) && snapshot.key_frame(id).is_some_and(fits);
    let similar = snapshot.similar_key_frames(&here.bag, left, all, &found, may_show);
    found.extend(
        similar.into_iter().filter(|(_, similarity)| *similarity >= MIN_SIMILARITY * usual).map(|(id, _)| id),
    );
    found
}
