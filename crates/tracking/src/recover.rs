//! Finding the pose by appearance alone, when the motion model has failed or tracking is lost.

use crate::match_last::{Matches, TIGHT};
use cairn_atlas::{KeyFrame, KeyFrameId, Snapshot};
use cairn_geometry::Vec3;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{DescriptorQuery, Frame, match_descriptors};

/// Key frames around the last place that are tried in turn.
const NEAR: usize = 12;
/// Places that look alike by their words that are tried in each frame.
const ALIKE: usize = 3;
/// Neighbours of a key frame that count as the same place.
const GROUP: usize = 10;

/// Matches every landmark that a key frame shows with the features of a frame, by descriptor alone.
pub(crate) fn match_key_frame(key_frame: &KeyFrame, frame: &Frame, ratio: f64) -> Matches {
    let seen = &key_frame.frame;
    let looks = key_frame.landmarks.iter().enumerate().filter_map(|(i, id)| {
        Some(DescriptorQuery { item: (*id)?, descriptor: &seen.descriptors[i], angle: seen.angle[i] })
    });
    let mut matches = Matches::none(frame);
    for (feature, id) in match_descriptors(looks, frame, TIGHT, ratio) {
        matches.landmarks[feature] = Some(id);
    }
    matches
}

/// Key frames to try when lost: the one nearest to where the eye was last, one of the others near there in turn, and those
/// of any world that look most alike by their words, one of each group of neighbours.
pub(crate) fn candidates(
    snapshot: &Snapshot,
    frame: &Frame,
    last: Option<Vec3>,
    turn: usize,
) -> Vec<KeyFrameId> {
    let mut found = Vec::new();
    if let Some(last) = last {
        let mut all: Vec<(f64, KeyFrameId)> =
            snapshot.key_frames().map(|k| ((k.world_from_camera.translation - last).norm(), k.id)).collect();
        all.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        found.extend(all.first().map(|(_, id)| *id));
        found.extend(all.get(1 + turn % NEAR).map(|(_, id)| *id));
    }
    let bag = Vocabulary::embedded().bag(&frame.descriptors);
    let alike = snapshot.places_like(&bag, ALIKE, GROUP, &found, |_| true);
    found.extend(alike.into_iter().map(|(id, _)| id));
    found
}
