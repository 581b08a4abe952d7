//! Finding the pose by appearance alone, when the motion model has failed or tracking is lost.

use crate::match_last::{Matches, TIGHT, one_feature_each};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, Map};
use cairn_geometry::Vec3;
use cairn_vision::{Frame, best_two, consistent_rotation};

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

/// Key frames to try when lost, in order: those around where the eye was last, then the others, newest first.
pub(crate) fn candidates(map: &Map, last: Option<Vec3>, limit: usize) -> Vec<KeyFrameId> {
    let mut all: Vec<(f64, KeyFrameId)> = map
        .key_frames()
        .map(|k| (last.map_or(0.0, |at| (k.world_from_eye.translation - at).norm()), k.id))
        .collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    all.into_iter().map(|(_, id)| id).take(limit).collect()
}
