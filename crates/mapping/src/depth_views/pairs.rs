//! Which key frames of a map are aligned with which.

use super::view::{Shrink, View};
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::Se3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Earlier key frames that each is aligned with, at most: of those that share landmarks with it, and as many of those that do not.
const EACH: usize = 3;
/// Both show at least this share of what the other shows.
const LEAST_OVERLAP: f64 = 0.35;
/// Cameras farther apart are not looked at, metres.
const NEAR_M: f64 = 3.0;
/// Nor those whose axes have a smaller cosine: they see other sides of things.
const LEAST_COSINE: f64 = 0.26;

/// An earlier and a later key frame that show one surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Pair {
    pub from: KeyFrameId,
    pub to: KeyFrameId,
    /// Landmarks they share, where these are many enough to count as covisible; else 0.
    pub shared: u32,
}

/// The pairs of a map, those with the most overlap for each key frame.
pub(super) fn pairs(
    snapshot: &Snapshot,
    map: MapId,
    views: &BTreeMap<KeyFrameId, Arc<View>>,
    shrink: &Shrink,
    camera_from_depth: &Se3,
) -> Vec<Pair> {
    let depth_from_camera = camera_from_depth.inverse();
    let mut all: Vec<(&KeyFrame, &View)> =
        snapshot.key_frames_of(map).filter_map(|k| Some((k, &**views.get(&k.id)?))).collect();
    all.sort_by_key(|(k, _)| k.id);
    let mut out = Vec::new();
    for (n, (to, to_view)) in all.iter().enumerate() {
        let mut best: [Vec<(f64, Pair)>; 2] = Default::default();
        for (from, from_view) in &all[..n] {
            let from_from_to = depth_from_camera * from.here_from(to) * *camera_from_depth;
            let cosine = from_from_to.rotation.matrix()[(2, 2)];
            if from_from_to.translation.norm() > NEAR_M || cosine < LEAST_COSINE {
                continue;
            }
            let overlap = shrink.overlap(from_view, to_view, &from_from_to);
            if overlap >= LEAST_OVERLAP {
                let shared = to.covisible.iter().find(|(id, _)| *id == from.id).map_or(0, |(_, n)| *n);
                best[usize::from(shared > 0)].push((overlap, Pair { from: from.id, to: to.id, shared }));
            }
        }
        for mut of_kind in best {
            of_kind.sort_by(|a, b| b.0.total_cmp(&a.0));
            out.extend(of_kind.into_iter().take(EACH).map(|(_, pair)| pair));
        }
    }
    out
}
