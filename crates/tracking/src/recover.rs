//! Relocalisation: finding the pose by appearance alone, when the motion model has failed or tracking is
//! lost.

use crate::match_last::{Matches, TIGHT};
use cairn_atlas::{KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{DescriptorQuery, Frame, RectifiedCamera, match_descriptors};

/// Key frames near the last known position that are tried in turn.
const NEAR: usize = 12;
/// Most similar key frames by bag of words that are tried in each frame.
pub(crate) const SIMILAR: usize = 3;
/// Covisible neighbours of a key frame that count as the same place.
pub(crate) const GROUP: usize = 10;

/// Needed to recognise a place: seed matches by appearance that agree, and the share of expected landmarks that
/// agree in the end.
pub(crate) const RECOGNISE_SEED: usize = 12;
pub(crate) const RECOGNISE_SHARE: f64 = 0.4;

/// Matches every landmark observed by a key frame with the features of a frame, by descriptor alone.
pub(crate) fn match_key_frame(key_frame: &KeyFrame, frame: &Frame, ratio: f64) -> Matches {
    let shown_in = &key_frame.frame;
    let queries = key_frame.landmarks.iter().enumerate().filter_map(|(i, id)| {
        Some(DescriptorQuery { item: (*id)?, descriptor: &shown_in.descriptors[i], angle: shown_in.angle[i] })
    });
    let mut matches = Matches::none(frame);
    for (feature, id) in match_descriptors(queries, frame, TIGHT, ratio) {
        matches.landmarks[feature] = Some(id);
    }
    matches
}

/// Key frames to try when lost: the one nearest to the last known camera position, one of the others near
/// there in turn, and those of any map that are most similar by bag of words, one of each group of
/// neighbours. A camera with depth has no place in a map without metres: what it measures would contradict the landmarks.
pub(crate) fn candidates(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    frame: &Frame,
    last: Option<Vec3>,
    turn: usize,
) -> Vec<KeyFrameId> {
    let fits = |k: &KeyFrame| !camera.has_depth() || snapshot.is_metric_in(k.map, camera);
    let mut found = Vec::new();
    if let Some(last) = last {
        let distance = |k: &KeyFrame| (k.world_from_camera.translation - last).norm();
        let mut all: Vec<(f64, KeyFrameId)> =
            snapshot.key_frames().filter(|k| fits(k)).map(|k| (distance(k), k.id)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        found.extend(all.first().map(|(_, id)| *id));
        found.extend(all.get(1 + turn % NEAR).map(|(_, id)| *id));
    }
    let bag = Vocabulary::current().bag(&frame.descriptors);
    let fits = |id: KeyFrameId| snapshot.key_frame(id).is_some_and(fits);
    let similar = snapshot.similar_key_frames(&bag, SIMILAR, GROUP, &found, fits);
    found.extend(similar.into_iter().map(|(id, _)| id));
    found
}
