//! Places of a map that look like a given one.

use crate::{KeyFrameId, Snapshot};
use cairn_vision::bow::BagOfWords;

/// Key frames compared for each place asked for: neighbours are similar, too.
const POOL: usize = 8;

impl Snapshot {
    /// The places of any map most similar to a bag, best first, with their similarity: one key frame of each
    /// group of neighbours, `most` at most, none of the groups of those in `tried`, and only key frames that
    /// `accept` admits. A group is formed by the `neighbours` that share most landmarks with a key frame.
    pub fn similar_key_frames(
        &self,
        bag: &BagOfWords,
        most: usize,
        neighbours: usize,
        tried: &[KeyFrameId],
        accept: impl Fn(KeyFrameId) -> bool,
    ) -> Vec<(KeyFrameId, f64)> {
        let same_group = |id: KeyFrameId, other: KeyFrameId| {
            id == other
                || self
                    .key_frame(other)
                    .is_some_and(|k| k.covisible.iter().take(neighbours).any(|(near, _)| *near == id))
        };
        let mut found: Vec<(KeyFrameId, f64)> = Vec::new();
        for (id, similarity) in self.places().query(bag, POOL * most.max(3), accept) {
            if found.len() >= most {
                break;
            }
            let others = tried.iter().copied().chain(found.iter().map(|(id, _)| *id));
            if !others.into_iter().any(|other| same_group(id, other)) {
                found.push((id, similarity));
            }
        }
        found
    }
}
