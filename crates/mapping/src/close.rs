//! Coming back: a place that was mapped before is recognised near where it should be, and the drift since then is
//! spread over the way in between, so that the old landmarks serve again and the map stops growing.
//!
//! In: a key frame that has just been added, of an eye with depth. Out: changes that move what was mapped since and
//! join the landmarks seen again. The correction is spread in closed form over the chain of key frames, rotations
//! first, then what is left of the translation, after Dubbelman & Browning, "COP-SLAM: closed-form online pose-chain
//! optimization for visual SLAM" (IEEE T-RO 2015), with weights by the length of the way instead of covariances.

use crate::fuse::around;
use cairn_adjust::locate;
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Map};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_vision::{EyeModel, Target, best_two, consistent_rotation, search};
use std::collections::{BTreeMap, BTreeSet};

/// Bits that may differ between two looks at one point, by appearance alone.
const TIGHT: u32 = 50;
/// The same where the place is known.
const LOOSE: u32 = 80;
/// Matches by appearance that must agree on a pose before more are sought.
const SEED: usize = 20;
/// Matches that must agree in the end, and the share of all found.
const NEED: usize = 40;
const SHARE: f64 = 0.5;
/// Key frames compared, at most.
const CANDIDATES: usize = 3;
/// A metre of way weighs as much as this many radians of turning.
const RADIANS_PER_METRE: f64 = 3.0;

/// A place seen again.
#[derive(Clone, Debug)]
pub(crate) struct Return {
    /// Key frame of the earlier visit.
    pub old: KeyFrameId,
    /// Where the new key frame stands when the earlier map is believed.
    pub world_from_eye: Se3,
    /// Features of the new key frame with the landmark of the earlier visit that each shows.
    pub matches: Vec<(usize, LandmarkId)>,
}

/// Looks whether a key frame sees what an unconnected key frame nearby has seen before.
pub(crate) fn find_return(map: &Map, eye: &EyeModel, centre: KeyFrameId) -> Option<Return> {
    let here = map.key_frame(centre)?;
    let mut known: BTreeSet<KeyFrameId> = around(map, centre, 20).into_iter().collect();
    known.extend(here.covisible.iter().map(|(id, _)| *id));
    known.insert(centre);
    candidates(map, eye, here, &known).into_iter().find_map(|old| recognise(map, eye, here, old))
}

/// Key frames that stand near and look the same way but are no neighbours, nearest first.
fn candidates(map: &Map, eye: &EyeModel, here: &KeyFrame, known: &BTreeSet<KeyFrameId>) -> Vec<KeyFrameId> {
    let axis = |k: &KeyFrame| k.world_from_eye.rotation * Vec3::z();
    let reach = eye.close_depth / 3.0;
    let mut near: Vec<(f64, KeyFrameId)> = map
        .key_frames()
        .filter(|k| !known.contains(&k.id) && axis(k).dot(&axis(here)) > 0.8)
        .map(|k| ((k.world_from_eye.translation - here.world_from_eye.translation).norm(), k.id))
        .filter(|(distance, _)| *distance < reach)
        .collect();
    near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    near.into_iter().map(|(_, id)| id).take(CANDIDATES).collect()
}

/// Matches by appearance, then by place, with the landmarks around an earlier key frame.
fn recognise(map: &Map, eye: &EyeModel, here: &KeyFrame, old: KeyFrameId) -> Option<Return> {
    let mut matches = alike(map.key_frame(old)?, here);
    if matches.iter().flatten().count() < SEED {
        return None;
    }
    let frame = &here.frame;
    let seed = locate(map, eye, frame, &here.world_from_eye, &matches, &[]);
    if seed.inliers < SEED {
        return None;
    }
    seed.outliers.iter().for_each(|i| matches[*i] = None);
    project(map, eye, here, old, &seed.world_from_eye, &mut matches);
    let all = matches.iter().flatten().count();
    let found = locate(map, eye, frame, &seed.world_from_eye, &matches, &[]);
    if found.inliers < NEED || (found.inliers as f64) < SHARE * all as f64 {
        return None;
    }
    found.outliers.iter().for_each(|i| matches[*i] = None);
    let matches = matches.iter().enumerate().filter_map(|(i, id)| Some((i, (*id)?))).collect();
    Some(Return { old, world_from_eye: found.world_from_eye, matches })
}

/// The landmark of `old` that each feature of `here` resembles.
fn alike(old: &KeyFrame, here: &KeyFrame) -> Vec<Option<LandmarkId>> {
    let all: Vec<u32> = (0..here.frame.len() as u32).collect();
    let mut owner: Vec<Option<(LandmarkId, u32, f32)>> = vec![None; here.frame.len()];
    for (i, id) in old.landmarks.iter().enumerate() {
        let Some(id) = id else { continue };
        let best = best_two(&old.frame.descriptors[i], &here.frame.descriptors, &all);
        if best.distance > TIGHT || best.distance as f64 > 0.8 * best.second as f64 {
            continue;
        }
        let slot = &mut owner[best.index as usize];
        if slot.is_none_or(|(_, distance, _)| best.distance < distance) {
            let turn = old.frame.angle[i] - here.frame.angle[best.index as usize];
            *slot = Some((*id, best.distance, turn));
        }
    }
    let turned = owner.iter().enumerate().filter_map(|(j, o)| o.map(|(id, _, turn)| ((j, id), turn)));
    let mut matches = vec![None; here.frame.len()];
    for (feature, id) in consistent_rotation(turned.collect()) {
        matches[feature] = Some(id);
    }
    matches
}

/// Adds landmarks of `old` and its neighbours that are found where they should be.
fn project(
    map: &Map,
    eye: &EyeModel,
    here: &KeyFrame,
    old: KeyFrameId,
    world_from_eye: &Se3,
    matches: &mut [Option<LandmarkId>],
) {
    let near = map.key_frame(old).into_iter().flat_map(|k| k.covisible.iter().take(5).map(|(id, _)| *id));
    let near: Vec<KeyFrameId> = std::iter::once(old).chain(near).collect();
    let all = near.iter().filter_map(|id| map.key_frame(*id)).flat_map(|k| k.landmarks.iter().flatten());
    let mut taken: BTreeSet<LandmarkId> = matches.iter().flatten().copied().collect();
    let wanted: BTreeSet<LandmarkId> = all.copied().collect();
    let (octaves, eye_from_world) = (map.octaves(), world_from_eye.inverse());
    for id in wanted {
        let Some(l) = map.landmark(id).filter(|l| l.feature_in(here.id).is_none()) else { continue };
        let q = eye_from_world * l.position;
        let Some([u, v, right]) = eye.project(&q) else { continue };
        let distance = q.norm();
        if !eye.contains(u, v) || distance < 0.8 * l.min_distance || distance > 1.2 * l.max_distance {
            continue;
        }
        if (l.position - world_from_eye.translation).dot(&l.normal) < 0.5 * distance {
            continue;
        }
        let level = octaves.predict(l.max_distance, distance);
        let target = Target {
            pixel: [u as f32, v as f32],
            right_x: right as f32,
            radius: (4.0 * octaves.scale(level)) as f32,
            octaves: [level.saturating_sub(1), level],
            descriptor: &l.descriptor,
        };
        let Some(found) = search(&here.frame, &target, |i| matches[i].is_none()) else { continue };
        if found.distance <= LOOSE && taken.insert(id) {
            matches[found.feature] = Some(id);
        }
    }
}

/// Moves what was mapped after `start` so that `centre` comes to stand at `world_from_eye`: key frames in order of
/// birth take their share by the length of the way so far, landmarks go with the first key frame that saw them.
pub(crate) fn spread(map: &Map, start: KeyFrameId, centre: KeyFrameId, world_from_eye: &Se3) -> Vec<Change> {
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

/// Joins what is seen again: the new key frame's landmarks become the earlier ones.
pub(crate) fn join(map: &Map, centre: KeyFrameId, matches: &[(usize, LandmarkId)]) -> Vec<Change> {
    let Some(here) = map.key_frame(centre) else { return Vec::new() };
    matches
        .iter()
        .map(|(feature, old)| match here.landmarks[*feature] {
            Some(new) => Change::Fuse(new, *old),
            None => Change::Observe(*old, centre, *feature as u16),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
