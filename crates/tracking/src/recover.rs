//! Finding the pose by appearance alone, when the motion model has failed or tracking is lost.

use crate::match_last::{Matches, TIGHT, one_feature_each};
use cairn_atlas::{KeyFrame, KeyFrameId, LandmarkId, Map};
use cairn_geometry::Vec3;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Frame, best_two, consistent_rotation};

/// Key frames around the last place that are tried in turn.
const NEAR: usize = 12;
/// Places that look alike by their words that are tried in each frame.
const ALIKE: usize = 3;

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

/// Key frames to try when lost: the one nearest to where the eye was last, one of the others near there in turn, and those
/// of any world that look most alike by their words, one of each group of neighbours.
pub(crate) fn candidates(map: &Map, frame: &Frame, last: Option<Vec3>, turn: usize) -> Vec<KeyFrameId> {
    let mut found = Vec::new();
    if let Some(last) = last {
        let mut all: Vec<(f64, KeyFrameId)> =
            map.key_frames().map(|k| ((k.world_from_eye.translation - last).norm(), k.id)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        found.extend(all.first().map(|(_, id)| *id));
        found.extend(all.get(1 + turn % NEAR).map(|(_, id)| *id));
    }
    let most = found.len() + ALIKE;
    let bag = Vocabulary::embedded().bag(&frame.descriptors);
    for (id, _) in map.places().query(&bag, 8 * ALIKE, |id| !found.contains(&id)) {
        let beside = |other: &KeyFrameId| {
            map.key_frame(*other).is_some_and(|k| k.covisible.iter().take(10).any(|(n, _)| *n == id))
        };
        if found.len() < most && !found.iter().any(beside) {
            found.push(id);
        }
    }
    found
}
