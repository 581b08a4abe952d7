//! Corrections: a map is merged into another, and landmarks seen again are fused.

use super::draft::Draft;
use crate::fuse::{around, fuse_into};
use cairn_adjust::Recognised;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot};
use cairn_geometry::Sim3;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeMap;

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

/// Fuses the landmarks seen again: those of each key frame into the earlier ones of the place that was recognised in it; then the
/// earlier ones are searched in the key frames around it, in each once for all places.
pub(super) fn fuse(draft: &mut Draft, camera: &RectifiedCamera, seen: &[(KeyFrameId, &Recognised)]) {
    for (here, place) in seen {
        let same = place.landmarks.iter().enumerate().filter_map(|(i, l)| Some((i, (*l)?)));
        let fused = fuse_matches(draft.snapshot(), *here, same);
        draft.push(fused);
    }
    let places: BTreeMap<KeyFrameId, Vec<LandmarkId>> =
        seen.iter().map(|(_, place)| (place.old, landmarks_around(draft.snapshot(), place.old))).collect();
    for (id, near) in searched(draft.snapshot(), seen) {
        let mut theirs: Vec<LandmarkId> =
            near.iter().filter_map(|old| places.get(old)).flatten().copied().collect();
        theirs.sort_unstable();
        theirs.dedup();
        let found = draft.snapshot().key_frame(id).map(|k| fuse_into(draft.snapshot(), camera, &theirs, k));
        draft.push(found.unwrap_or_default());
    }
}

/// The key frames around those in which places were recognised, each with these places.
fn searched(snapshot: &Snapshot, seen: &[(KeyFrameId, &Recognised)]) -> Vec<(KeyFrameId, Vec<KeyFrameId>)> {
    let mut all: Vec<(KeyFrameId, Vec<KeyFrameId>)> = Vec::new();
    let mut slots: BTreeMap<KeyFrameId, usize> = BTreeMap::new();
    for (here, place) in seen {
        let near = std::iter::once(*here).chain(around(snapshot, *here, FUSED / 2)).take(FUSED + 1);
        for id in near {
            let slot = *slots.entry(id).or_insert(all.len());
            if slot == all.len() {
                all.push((id, Vec::new()));
            }
            all[slot].1.push(place.old);
        }
    }
    all
}

/// The landmarks of a place: of the key frames around one.
fn landmarks_around(snapshot: &Snapshot, old: KeyFrameId) -> Vec<LandmarkId> {
    let mut all: Vec<LandmarkId> = std::iter::once(old)
        .chain(around(snapshot, old, FUSED / 2))
        .filter_map(|id| snapshot.key_frame(id))
        .flat_map(|k| k.landmarks.iter().flatten().copied())
        .collect();
    all.sort_unstable();
    all.dedup();
    all
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{World, stereo};
    use crate::tests::visited_twice;

    #[test]
    fn fuse_matches_fuses_two_landmarks_of_a_feature_and_observes_where_it_has_none() {
        let world = World::around(stereo(), 171);
        let (mut atlas, [older, younger]) = visited_twice(&world, &Sim3::identity());
        let shown = |id: KeyFrameId, snapshot: &Snapshot| snapshot.key_frame(id).unwrap().landmarks.clone();
        let here = younger[0];
        let features: Vec<usize> = (shown(here, atlas.latest()).iter().enumerate())
            .filter_map(|(feature, landmark)| landmark.map(|_| feature))
            .take(3)
            .collect();
        let new = shown(here, atlas.latest());
        // The second feature loses its landmark.
        atlas.commit(vec![Change::RemoveLandmark(new[features[1]].unwrap())]);
        let snapshot = atlas.latest();
        let (mine, old) = (shown(here, snapshot), shown(older[0], snapshot));
        let mut old = old.iter().flatten().copied();
        let (a, b) = (old.next().unwrap(), old.next().unwrap());
        let own = mine[features[2]].unwrap();
        let gone = snapshot.next_landmark_id();
        let same = [(features[0], a), (features[1], b), (features[2], own), (features[2], gone)];
        let changes = fuse_matches(snapshot, here, same.into_iter());
        match changes.as_slice() {
            [Change::Fuse(fused, into), Change::Observe(observed, by, feature)] => {
                assert_eq!((*fused, *into), (mine[features[0]].unwrap(), a));
                assert_eq!((*observed, *by, usize::from(*feature)), (b, here, features[1]));
            }
            other => panic!("{other:?}"),
        }
    }
}
