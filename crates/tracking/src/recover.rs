//! Finding the pose by appearance alone, when the motion model has failed or tracking is lost.

use crate::match_last::{Matches, TIGHT, one_feature_each};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, Map};
use cairn_geometry::Vec3;
use cairn_vision::{Frame, best_two, consistent_rotation};

/// Key frames around the last place that are tried more often than the others.
const NEAR: usize = 12;

/// Matches every landmark that a key frame shows with the features of a frame, by descriptor alone.
pub(crate) fn match_key_frame(key_frame: &KeyFrame, frame: &Frame, ratio: f64) -> Matches {
    let all: Vec<u32> = (0..frame.len() as u32).collect();
    let mut owner: Vec<Option<(LandmarkId, u32, f32)>> = vec![None; frame.len()];
    for (i, id) in key_frame.landmarks.iter().enumerate() {
        let Some(id) = id else { continue };
        let best = best_two(&key_frame.frame.descriptors[i], &frame.descriptors, &all);
        if best.distance > TIGHT || best.distance as f64 > ratio * best.second as f64 {
            continue;
        }
        let feature = best.index as usize;
        let turn = key_frame.frame.angle[i] - frame.angle[feature];
        if owner[feature].is_none_or(|(_, d, _)| best.distance < d) {
            owner[feature] = Some((*id, best.distance, turn));
        }
    }
    let turned =
        owner.iter().enumerate().filter_map(|(feature, o)| o.map(|(id, _, turn)| ((feature, id), turn)));
    let mut matches = Matches::none(frame);
    for (feature, id) in consistent_rotation(turned.collect()) {
        matches.landmarks[feature] = Some(id);
    }
    one_feature_each(&mut matches.landmarks);
    matches
}

/// Key frames to try when lost: of those around where the eye was last, and of all the others, a few in turn with the
/// number of frames since.
pub(crate) fn candidates(map: &Map, last: Option<Vec3>, turn: usize) -> Vec<KeyFrameId> {
    let mut all: Vec<(f64, KeyFrameId)> = map
        .key_frames()
        .map(|k| (last.map_or(0.0, |at| (k.world_from_eye.translation - at).norm()), k.id))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let (near, far) = all.split_at(all.len().min(NEAR));
    let tried = near.iter().take(2).chain(cycled(near, turn)).chain(cycled(far, turn));
    let mut ids: Vec<KeyFrameId> = tried.map(|(_, id)| *id).collect();
    ids.dedup();
    ids
}

/// Two of a list, further on with each turn.
fn cycled<T>(list: &[T], turn: usize) -> impl Iterator<Item = &T> {
    list.iter().cycle().skip(2 * turn % list.len().max(1)).take(2.min(list.len()))
}
