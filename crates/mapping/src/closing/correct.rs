//! Corrections: a loop's drift is spread over the map, a world is moved into another, landmarks seen again are joined.

use super::draft::Draft;
use crate::fuse::{around, fuse_into};
use cairn_adjust::Recognised;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Map};
use cairn_geometry::{Se3, Sim3, So3};
use cairn_vision::EyeModel;
use std::collections::BTreeMap;

/// A metre of way weighs as much as this many radians of turning.
const RADIANS_PER_METRE: f64 = 3.0;

/// Neighbours of a key frame in which the landmarks of the earlier visit are sought.
const FUSED: usize = 12;

/// Moves a younger world into an older one; `there_from_here` leads from the key frame's world to the earlier one's.
pub(super) fn merge(draft: &mut Draft, here: &KeyFrame, old: KeyFrameId, there_from_here: &Sim3) {
    let map = draft.map();
    let Some(there) = map.key_frame(old).map(|k| k.world) else { return };
    let (from, into, into_from, meeting) = if here.world > there {
        (here.world, there, *there_from_here, old)
    } else {
        (there, here.world, there_from_here.inverse(), here.id)
    };
    // Parents are older than their children: up the tree from where the worlds meet, until that is so.
    let mut parent = meeting;
    while parent >= from.root() {
        match map.key_frame(parent).and_then(|k| k.parent) {
            Some(older) => parent = older,
            None => break,
        }
    }
    draft.push(vec![Change::Merge { from, into, into_from, parent }, Change::Link(here.id, old)]);
}

/// Brings a key frame to where an earlier visit puts it and spreads the drift since then.
pub(super) fn close_loop(draft: &mut Draft, here: KeyFrameId, old: KeyFrameId, world_from_here: &Sim3) {
    let to = Se3::new(world_from_here.rotation, world_from_here.translation);
    let changes = spread(draft.map(), old, here, &to);
    draft.push(changes);
    draft.push(vec![Change::Link(here, old)]);
}

/// Moves what was mapped after `start` so that `centre` comes to stand at `world_from_eye`: key frames in order of
/// birth take their share by the length of the way so far, landmarks go with the first key frame that saw them.
fn spread(map: &Map, start: KeyFrameId, centre: KeyFrameId, world_from_eye: &Se3) -> Vec<Change> {
    let chain: Vec<&KeyFrame> = map.key_frames().filter(|k| k.id >= start && k.id <= centre).collect();
    let before: Vec<Se3> = chain.iter().map(|k| k.world_from_eye).collect();
    let after = bend(&before, world_from_eye);
    let mut moved: BTreeMap<KeyFrameId, Se3> = BTreeMap::new();
    let mut changes = Vec::new();
    for (k, (old, new)) in chain.iter().zip(before.iter().zip(&after)).skip(1) {
        moved.insert(k.id, *new * old.inverse());
        changes.push(Change::MoveKeyFrame(k.id, *new));
    }
    for l in map.landmarks() {
        let first = l.observations.first().and_then(|o| moved.get(&o.key_frame));
        if let Some(shift) = first {
            changes.push(Change::MoveLandmark(l.id, *shift * l.position));
        }
    }
    changes
}

/// The chain of poses with its first where it was and its last at `end`.
fn bend(chain: &[Se3], end: &Se3) -> Vec<Se3> {
    let Some(last) = chain.last() else { return Vec::new() };
    let mut way = vec![0.0];
    for w in chain.windows(2) {
        let turned = (w[0].rotation.inverse() * w[1].rotation).angle();
        let step = (w[1].translation - w[0].translation).norm() + turned / RADIANS_PER_METRE;
        way.push(way[way.len() - 1] + step);
    }
    let total = way[way.len() - 1].max(1e-9);
    let turn = (end.rotation * last.rotation.inverse()).log();
    let share = |i: usize| way[i] / total;
    let turns: Vec<So3> = (0..chain.len()).map(|i| So3::exp(&(turn * share(i)))).collect();
    let mut places = vec![chain[0].translation];
    for (i, w) in chain.windows(2).enumerate() {
        // Each step keeps its length and turns with the key frame it starts from.
        places.push(places[i] + turns[i] * (w[1].translation - w[0].translation));
    }
    let left = end.translation - places[places.len() - 1];
    (0..chain.len()).map(|i| Se3::new(turns[i] * chain[i].rotation, places[i] + left * share(i))).collect()
}

/// Joins the landmarks seen again: those of the key frame become the earlier ones, and around it the earlier ones are
/// sought where they must be.
pub(super) fn fuse(draft: &mut Draft, eye: &EyeModel, here: KeyFrameId, place: &Recognised) {
    let same = place.landmarks.iter().enumerate().filter_map(|(i, l)| Some((i, (*l)?)));
    let joined = join(draft.map(), here, same);
    draft.push(joined);
    let mut theirs: Vec<LandmarkId> = std::iter::once(place.old)
        .chain(around(draft.map(), place.old, FUSED / 2))
        .filter_map(|id| draft.map().key_frame(id))
        .flat_map(|k| k.landmarks.iter().flatten().copied())
        .collect();
    theirs.sort_unstable();
    theirs.dedup();
    let near: Vec<KeyFrameId> =
        std::iter::once(here).chain(around(draft.map(), here, FUSED / 2)).take(FUSED + 1).collect();
    for id in near {
        let found = draft.map().key_frame(id).map(|k| fuse_into(draft.map(), eye, &theirs, k));
        draft.push(found.unwrap_or_default());
    }
}

fn join(map: &Map, here: KeyFrameId, same: impl Iterator<Item = (usize, LandmarkId)>) -> Vec<Change> {
    let Some(k) = map.key_frame(here) else { return Vec::new() };
    same.map(|(feature, old)| match k.landmarks[feature] {
        Some(new) => Change::Fuse(new, old),
        None => Change::Observe(old, here, feature as u16),
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;

    #[test]
    fn a_chain_that_drifted_comes_home_and_its_start_stays() {
        // A square walked with a small error in each step.
        let step =
            |error: f64| Se3::new(So3::exp(&Vec3::new(0.0, 0.157 + error, 0.0)), Vec3::new(error, 0.0, 0.5));
        let walk = |error: f64| {
            let mut poses = vec![Se3::identity()];
            for i in 0..40 {
                poses.push(poses[i] * step(error));
            }
            poses
        };
        let (truth, drifted) = (walk(0.0), walk(0.002));
        let bent = bend(&drifted, &truth[40]);
        assert_eq!(bent[0].translation, truth[0].translation);
        assert!((bent[40].translation - truth[40].translation).norm() < 1e-9);
        assert!((bent[40].rotation.inverse() * truth[40].rotation).angle() < 1e-9);
        let error = |poses: &[Se3]| -> f64 {
            poses.iter().zip(&truth).map(|(a, b)| (a.translation - b.translation).norm()).sum::<f64>() / 41.0
        };
        assert!(error(&bent) < 0.3 * error(&drifted), "{} of {}", error(&bent), error(&drifted));
    }

    #[test]
    fn a_chain_that_is_right_stays() {
        let chain: Vec<Se3> =
            (0..5).map(|i| Se3::new(So3::identity(), Vec3::new(i as f64, 0.0, 0.0))).collect();
        for (a, b) in bend(&chain, &chain[4]).iter().zip(&chain) {
            assert!((a.translation - b.translation).norm() < 1e-12);
        }
        assert!(bend(&[], &Se3::identity()).is_empty());
    }
}
