//! Fusion of duplicate landmarks: those of a key frame are projected into its neighbours, and theirs into it.

use cairn_adjust::{pixel, weight};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, LandmarkId, Snapshot, Viewpoint};
use cairn_solve::{CHI2_2, CHI2_3};
use cairn_vision::{RectifiedCamera, Target, search};
use std::collections::BTreeSet;

/// Largest Hamming distance of a match, bits.
const TIGHT: u32 = 50;
/// Half the search window in pixels at the predicted pyramid level.
const RADIUS: f64 = 3.0;

/// Key frames around `centre`: its best neighbours and their best neighbours.
pub(crate) fn around(snapshot: &Snapshot, centre: KeyFrameId, neighbours: usize) -> Vec<KeyFrameId> {
    let Some(k) = snapshot.key_frame(centre) else { return Vec::new() };
    let mut near: Vec<KeyFrameId> = k.covisible.iter().map(|(id, _)| *id).take(neighbours).collect();
    for i in 0..near.len() {
        let second = snapshot
            .key_frame(near[i])
            .map(|k| k.covisible.iter().take(3).map(|(id, _)| *id).collect::<Vec<_>>());
        for id in second.unwrap_or_default() {
            if id != centre && !near.contains(&id) {
                near.push(id);
            }
        }
    }
    near
}

/// The fusions and observations that result when `landmarks` are searched in a key frame; `camera` is that of the atlas.
pub(crate) fn fuse_into(
    snapshot: &Snapshot,
    camera: &RectifiedCamera,
    landmarks: &[LandmarkId],
    target: &KeyFrame,
) -> Vec<Change> {
    let octaves = snapshot.octaves();
    let (camera, focal_ratio) = (target.camera(camera), target.focal_ratio());
    let viewpoint = Viewpoint::of_camera(camera, &target.world_from_camera, focal_ratio);
    let mut changes = Vec::new();
    let mut touched: BTreeSet<usize> = BTreeSet::new();
    for id in landmarks {
        let Some(l) = snapshot.landmark(*id) else { continue };
        if l.feature_in(target.id).is_some() {
            continue;
        }
        let Some(seen) = viewpoint.sees(l) else { continue };
        let [u, v, right] = seen.pixel;
        let level = octaves.predict(seen.farthest, seen.distance);
        let aim = Target {
            pixel: [u as f32, v as f32],
            right_x: f32::NAN,
            radius: (RADIUS * octaves.scale(level)) as f32,
            octaves: [level.saturating_sub(1), level],
            descriptor: &l.descriptor,
        };
        let agrees = |i: usize| {
            let [mu, mv, mr] = pixel(snapshot, &target.frame, i);
            let dr = if mr.is_nan() { 0.0 } else { mr - right };
            let chi2 = ((mu - u).powi(2) + (mv - v).powi(2) + dr * dr) * weight(&target.frame, i, &octaves);
            chi2 < if mr.is_nan() { CHI2_2 } else { CHI2_3 }
        };
        let Some(found) = search(&target.frame, &aim, agrees) else { continue };
        if found.distance > TIGHT || !touched.insert(found.feature) {
            continue;
        }
        match target.landmarks[found.feature].and_then(|other| snapshot.landmark(other)) {
            Some(other) if other.observations.len() > l.observations.len() => {
                changes.push(Change::Fuse(*id, other.id))
            }
            Some(other) => changes.push(Change::Fuse(other.id, *id)),
            None => changes.push(Change::Observe(*id, target.id, found.feature as u16)),
        }
    }
    changes
}
