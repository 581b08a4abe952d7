//! Cutting an atlas into tiles: cubes of a grid along the vertical and two horizontal axes of each map, each tile with the key frames in
//! its cube and those of a margin around it, as a map file of its own. Names and coordinates are those of the atlas.

use super::{bytes_of, map_file};
use crate::shelf::Shelf;
use crate::task::{Result as Found, Tile, Tiled};
use crate::{Digest, FleetError, place_index};
use cairn::atlas::store::MapFile;
use cairn::atlas::{KeyFrame, KeyFrameId, MapId};
use cairn::geometry::Vec3;
use std::collections::{BTreeMap, BTreeSet};

/// Cuts an atlas.
pub(crate) fn tiles(shelf: &Shelf, atlas: Digest, tile_m: f64, margin_m: f64) -> Result<Found, FleetError> {
    let file = map_file(shelf, atlas)?;
    let mut list = Vec::new();
    for (map, _) in file.snapshot.maps() {
        for (cell, core, keep) in cubes(&file, map, tile_m, margin_m) {
            let Some(snapshot) = file.snapshot.cut(&keep) else { continue };
            let words = place_index::words_of(core.iter().filter_map(|id| file.snapshot.key_frame(*id)));
            let piece = MapFile { snapshot, about: file.about.clone(), attached: BTreeMap::new() };
            let tile = Tile {
                map: shelf.keep(&bytes_of(&piece)?)?,
                root: map.root().index(),
                cell,
                key_frames: [core.len(), keep.len()],
            };
            list.push((tile, words));
        }
    }
    let bytes = postcard::to_stdvec(&list).map_err(|e| FleetError::new("tiles", e, "report this"))?;
    Ok(Found::Tiled(Tiled {
        list: shelf.keep(&bytes)?,
        tiles: list.len(),
        bytes: list.iter().map(|(tile, _)| tile.map.bytes).sum(),
        key_frames: list.iter().map(|(tile, _)| tile.key_frames[1]).sum(),
    }))
}

/// A cube, the key frames in it, and those with its margin.
type Cube = (Option<[i32; 3]>, BTreeSet<KeyFrameId>, BTreeSet<KeyFrameId>);

fn cubes(file: &MapFile, map: MapId, tile_m: f64, margin_m: f64) -> Vec<Cube> {
    let key_frames = || file.snapshot.key_frames_of(map);
    let all: BTreeSet<KeyFrameId> = key_frames().map(|k| k.id).collect();
    let root = file.snapshot.key_frame(map.root()).map(|k| k.world_from_camera.translation);
    let Some(root) = root.filter(|_| file.snapshot.is_metric_in(map, &file.about.camera)) else {
        // Where lengths are not metres, nothing says how large a cube is.
        return vec![(None, all.clone(), all)];
    };
    let axes = axes(key_frames());
    let at = |k: &KeyFrame| axes.map(|axis| (k.world_from_camera.translation - root).dot(&axis));
    // Cells are counted from half a cube before the root, so that a small map is in one.
    let cell = |x: f64| (x / tile_m + 0.5).floor() as i32;
    let mut cubes: BTreeMap<[i32; 3], (BTreeSet<KeyFrameId>, BTreeSet<KeyFrameId>)> = BTreeMap::new();
    for k in key_frames() {
        cubes.entry(at(k).map(cell)).or_default().0.insert(k.id);
    }
    for k in key_frames() {
        let at = at(k);
        let [x, y, z] = at.map(|x| cell(x - margin_m)..=cell(x + margin_m));
        for x in x {
            for (y, z) in y.clone().flat_map(|y| z.clone().map(move |z| (y, z))) {
                if let Some((_, keep)) = cubes.get_mut(&[x, y, z]) {
                    keep.insert(k.id);
                }
            }
        }
    }
    cubes.into_iter().map(|(cell, (core, keep))| (Some(cell), core, keep)).collect()
}

/// Two horizontal axes and up: against the mean of where the cameras' rows go down, which is upright for whoever carries one.
fn axes<'a>(key_frames: impl Iterator<Item = &'a KeyFrame>) -> [Vec3; 3] {
    let down: Vec3 = key_frames.map(|k| k.world_from_camera.rotation * Vec3::y()).sum();
    let up = (-down).try_normalize(1e-9).unwrap_or_else(Vec3::z);
    // The axis of the map that is least vertical gives the first one.
    let mut least = Vec3::x();
    for axis in [Vec3::y(), Vec3::z()] {
        if axis.dot(&up).abs() + 1e-9 < least.dot(&up).abs() {
            least = axis;
        }
    }
    let first = (least - up * least.dot(&up)).normalize();
    [first, up.cross(&first), up]
}
