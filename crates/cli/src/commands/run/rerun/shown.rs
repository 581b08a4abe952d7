//! What of a map is drawn.

use super::pipe::{Pipe, pose, single};
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_dense::TsdfVolume;
use cairn_engine::DenseMapper;
use cairn_geometry::Vec3;
use cairn_rerun::{Colour, Show};
use std::collections::BTreeMap;

/// Voxels along the edge of a block (see [`cairn_dense::BlockKey`]).
const BLOCK_VOXELS: f64 = 8.0;

/// The entity of a map.
pub fn root(map: MapId) -> String {
    format!("map{}", map.root().index())
}

/// The map that a key frame is in, or what became of it.
pub fn map_of(snapshot: &Snapshot, key_frame: KeyFrameId) -> Option<MapId> {
    let (ancestor, _) = snapshot.surviving_ancestor(key_frame)?;
    snapshot.key_frame(ancestor).map(|k| k.map)
}

/// Points and lines of one map, in its world frame.
#[derive(Default)]
pub struct MapView {
    /// The landmarks.
    pub points: Vec<[f32; 3]>,
    /// The positions of the key frames.
    pub key_frames: Vec<[f32; 3]>,
    /// From each key frame to its parent.
    pub tree: Vec<Vec<[f32; 3]>>,
    /// Between key frames that a loop closure joined.
    pub loops: Vec<Vec<[f32; 3]>>,
    /// Where the body went, as the latest map corrects it.
    pub path: Vec<Vec<[f32; 3]>>,
}

impl MapView {
    /// The view of a map, with the path in it.
    pub fn of(snapshot: &Snapshot, map: MapId, path: Vec<Vec<[f32; 3]>>) -> Self {
        let at = |k: &KeyFrame| single(&k.world_from_camera.translation);
        let key_frames: Vec<&KeyFrame> = snapshot.key_frames_of(map).collect();
        let to = |k: &KeyFrame, other: KeyFrameId| {
            snapshot.key_frame(other).filter(|o| o.map == map).map(|o| vec![at(k), at(o)])
        };
        let of_map = |k: KeyFrameId| map_of(snapshot, k) == Some(map);
        Self {
            points: snapshot
                .landmarks()
                .filter(|l| l.observations.first().is_some_and(|o| of_map(o.key_frame)))
                .map(|l| single(&l.position))
                .collect(),
            key_frames: key_frames.iter().map(|k| at(k)).collect(),
            tree: key_frames.iter().filter_map(|k| to(k, k.parent?)).collect(),
            // Both ends name each other; each edge is drawn once.
            loops: key_frames
                .iter()
                .flat_map(|k| k.links.iter().filter(|other| **other < k.id).filter_map(|other| to(k, *other)))
                .collect(),
            path,
        }
    }
}

/// Two opposite corners of all blocks of a field, in metres; `None` while it is empty.
fn extent(field: &TsdfVolume) -> Option<[[f32; 3]; 2]> {
    let block_m = BLOCK_VOXELS * field.config().voxel_m;
    let corners = field.changed_since(0).map(|block| {
        let low = Vec3::from(block.0.map(f64::from)) * block_m;
        [low, low.add_scalar(block_m)]
    });
    let [low, high] = corners.reduce(|[low, high], [a, b]| [low.inf(&a), high.sup(&b)])?;
    Some([single(&low), single(&high)])
}

/// Draws the submaps of the depth, each as a box of its own; `drawn` counts those of each map, so that boxes of submaps that
/// moved to another map are emptied.
pub fn submaps(to: &mut Pipe, dense: &DenseMapper, drawn: &mut BTreeMap<MapId, usize>, snapshot: &Snapshot) {
    let mut counts = BTreeMap::new();
    for submap in dense.map().submaps() {
        let of = |map: &MapId| map.root().index() as u64 == submap.map.0;
        let Some(map) = snapshot.maps().map(|(map, _)| map).find(of) else { continue };
        let extent = submap.tsdf.map(extent);
        if extent == Some(None) {
            continue;
        }
        let number = counts.entry(map).or_insert(0);
        let entity = format!("{}/submaps/{number}", root(map));
        *number += 1;
        to.show(&entity, pose(&submap.world_from_submap));
        // The box of one whose field is released stays as it was drawn.
        if let Some(extent) = extent.flatten() {
            to.show(entity, Show::Boxes(vec![extent], Colour::GREY));
        }
    }
    for (map, before) in &*drawn {
        for number in counts.get(map).copied().unwrap_or(0)..*before {
            let entity = format!("{}/submaps/{number}", root(*map));
            to.show(entity, Show::Boxes(Vec::new(), Colour::GREY));
        }
    }
    *drawn = counts;
}
