//! Corrections: a map is merged into another, and landmarks seen again are fused.

use super::draft::Draft;
use crate::fuse::{around, fuse_into};
use cairn_adjust::Recognised;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Sim3;
use cairn_vision::RectifiedCamera;

/// Neighbours of a key frame in which the landmarks of the earlier visit are searched.
const FUSED: usize = 12;

/// Merges a younger map into an older one; `there_from_here` transforms from the key frame's map to the
/// earlier one's.
pub(super) fn merge(draft: &mut Draft, here: &KeyFrame, old: KeyFrameId, there_from_here: &Sim3) {
    let snapshot = draft.snapshot();
    let Some(there) = snapshot.key_frame(old).map(|k| k.map) else { return };
    let (from, into, into_from, meeting_point) = if here.map > there {
        (here.map, there, *there_from_here, old)
    } else {
        (there, here.map, there_from_here.inverse(), here.id)
    };
    // Parents are older than their children: go up the tree from where the maps meet, until that holds.
    let mut parent = meeting_point;
    while parent >= from.root() {
        match snapshot.key_frame(parent).and_then(|k| k.parent) {
            Some(older) => parent = older,
            None => break,
        }
    }
    draft.push(vec![Change::Merge { from, into, into_from, parent }, Change::Link(here.id, old)]);
}

/// Fuses the landmarks seen again: those of the key frame are fused into the earlier ones, and the earlier ones are
/// searched in the key frames around it.
pub(super) fn fuse(draft: &mut Draft, camera: &RectifiedCamera, here: KeyFrameId, place: &Recognised) {
    let same = place.landmarks.iter().enumerate().filter_map(|(i, l)| Some((i, (*l)?)));
    let fused = fuse_matches(draft.snapshot(), here, same);
    draft.push(fused);
    let mut theirs: Vec<LandmarkId> = std::iter::once(place.old)
        .chain(around(draft.snapshot(), place.old, FUSED / 2))
        .filter_map(|id| draft.snapshot().key_frame(id))
        .flat_map(|k| k.landmarks.iter().flatten().copied())
        .collect();
    theirs.sort_unstable();
    theirs.dedup();
    let near: Vec<KeyFrameId> =
        std::iter::once(here).chain(around(draft.snapshot(), here, FUSED / 2)).take(FUSED + 1).collect();
    for id in near {
        let found = draft.snapshot().key_frame(id).map(|k| fuse_into(draft.snapshot(), camera, &theirs, k));
        draft.push(found.unwrap_or_default());
    }
}

fn fuse_matches(
    snapshot: &Snapshot,
    here: KeyFrameId,
    same: impl Iterator<Item = (usize, LandmarkId)>,
) -> Vec<Change> {
    let Some(k) = snapshot.key_frame(here) else { return Vec::new() };
    // With several places recognised, another one may have fused them before.
    same.filter(|(_, old)| snapshot.landmark(*old).is_some())
        .filter_map(|(feature, old)| match k.landmarks[feature] {
            Some(new) if new == old => None,
            Some(new) => Some(Change::Fuse(new, old)),
            None => Some(Change::Observe(old, here, feature as u16)),
        })
        .collect()
}
