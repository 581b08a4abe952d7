//! Which key frames of a robot others need features of, to tell whether they saw the same places: of those that look like one of
//! the other's by words, a few along the way (Lajoie et al., "DOOR-SLAM", 2020, exchange in this order).

use crate::MapWords;
use cairn_atlas::{KeyFrameId, KeyFrameName, RobotId, Snapshot};
use std::collections::BTreeSet;

/// Key frames whose features go to another robot, at most; places at three positions must agree.
pub const MOST_PLACES: usize = 6;

/// The key frames of a robot whose features another one needs, by their numbers: of all that look like one of its, evenly chosen, and
/// where there is a choice those whose features are given already.
pub fn candidates(own: &MapWords, other: &MapWords, given: &BTreeSet<u32>) -> BTreeSet<u32> {
    let similar = own.similar_key_frames(other);
    let stretches = similar.chunks(similar.len().div_ceil(MOST_PLACES).max(1));
    let chosen = stretches.map(|stretch| {
        let middle = stretch[stretch.len() / 2];
        let given = stretch.iter().filter(|seq| given.contains(seq));
        given.copied().min_by_key(|seq| seq.abs_diff(middle)).unwrap_or(middle)
    });
    chosen.collect()
}

/// A map of these key frames alone, with the landmarks that they show; `None` where there is none of them.
pub fn only(snapshot: &Snapshot, robot: RobotId, seqs: &BTreeSet<u32>) -> Option<Snapshot> {
    let id = |seq: &u32| snapshot.key_frame_named(KeyFrameName { robot, seq: *seq });
    let keep: BTreeSet<KeyFrameId> = seqs.iter().filter_map(id).collect();
    snapshot.cut(&keep)
}
