//! Depth of key frames to and from a saved map: a dense map goes on from where it was saved.
//!
//! Only the compressed images and their places are saved; volumes are fused again from them. Places name key frames by
//! their lasting names, and so survive merges of files as recorded routes do.

use super::{DenseMapper, anchor, dense_map};
use cairn_atlas::store::{DepthPart, MapFile, Place, SavedDepth, StoreError};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_dense::{
    AnchorId, DenseError, DenseMap, PackedDepth, PackedGray, SavedFrame, SavedSubmap, SubmapConfig,
};
use cairn_geometry::Se3;
use std::sync::Arc;

/// Why there is no dense map of a saved map.
#[derive(Debug, thiserror::Error)]
pub enum SavedDepthError {
    /// It was saved without depth.
    #[error("the map carries no depth")]
    NoDepth,
    /// A part with depth is damaged.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The camera or the config cannot be used.
    #[error(transparent)]
    Dense(#[from] DenseError),
}

/// What was taken from a saved map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Restored {
    /// Submaps.
    pub submaps: usize,
    /// Depth images.
    pub images: usize,
    /// Images of a depth camera that is not the one in use: left out.
    pub other_camera: usize,
    /// Images that cannot be used: their key frame is not in the map.
    pub lost: usize,
}

/// The dense map of a saved map, for the depth camera of most of its images; its volumes are fused by
/// [`DenseMap::step`], and [`DenseMap::fuse_all`] needs none.
///
/// # Errors
/// [`SavedDepthError`] where the map carries no depth, it is damaged, or the config is out of range.
pub fn saved_dense_map(
    file: &MapFile,
    config: SubmapConfig,
) -> Result<(DenseMap, Restored), SavedDepthError> {
    let parts = file.depth()?;
    let images_like =
        |a: &DepthPart| parts.iter().filter(|b| same_camera(a, b)).map(|b| b.images.len()).sum::<usize>();
    let first = parts.iter().rev().max_by_key(|p| images_like(p)).ok_or(SavedDepthError::NoDepth)?;
    let mut map = DenseMap::new(config, first.camera, first.metres_per_unit)?;
    for k in file.snapshot.key_frames() {
        map.add_anchor(anchor(k.id), dense_map(k.map), k.world_from_camera)?;
    }
    let (restored, _) = restore(&mut map, &file.snapshot, parts, |_| None);
    Ok((map, restored))
}

impl DenseMapper {
    /// Takes over the depth of the saved map that the engine began in; to be called before the first frame. Parts of
    /// another depth camera are given back: they can be saved again as they are.
    pub fn restore(&mut self, parts: Vec<DepthPart>) -> (Restored, Vec<DepthPart>) {
        let start = self.from.start.clone();
        restore(&mut self.map, &start, parts, |_| None)
    }

    /// As [`DenseMapper::restore`], for images whose places name the key frames that they are of, removed or not: so that
    /// [`DenseMapper::forget`] finds them.
    pub fn restore_own(&mut self, parts: Vec<DepthPart>) -> (Restored, Vec<DepthPart>) {
        let start = self.from.start.clone();
        restore(&mut self.map, &start, parts, |place| start.key_frame_named(place.key_frame))
    }

    /// The depth of all key frames, to be saved with a snapshot. No pixels are copied.
    pub fn to_save(&mut self, snapshot: &Snapshot) -> Vec<DepthPart> {
        self.follow();
        let (camera, metres_per_unit) = self.map.camera();
        let place = |anchor: AnchorId, pose: Se3| {
            let id = KeyFrameId::from_index(usize::try_from(anchor.0).ok()?)?;
            // Mapping may have gone on since the snapshot: what is newer is saved the next time.
            snapshot.surviving_ancestor(id)?;
            Some(Place { key_frame: snapshot.key_frame_name(id), key_frame_from_it: pose })
        };
        let image = |f: SavedFrame| {
            let place = place(f.anchor, f.anchor_from_camera)?;
            let gray = f.gray.map_or_else(|| Arc::from([]), |gray| gray.as_bytes().clone());
            Some(SavedDepth { place, packed: f.depth.as_bytes().clone(), gray })
        };
        let part = |s: SavedSubmap| {
            let submap = place(s.anchor, s.anchor_from_submap)?;
            let images = s.frames.into_iter().filter_map(image).collect();
            Some(DepthPart { camera, metres_per_unit, submap, images })
        };
        self.map.saved().into_iter().filter_map(part).collect()
    }
}

fn same_camera(a: &DepthPart, b: &DepthPart) -> bool {
    a.camera == b.camera && a.metres_per_unit == b.metres_per_unit
}

/// Adds saved submaps to a dense map that has the anchors of a snapshot; also returns the parts of other cameras. `own` tells the key
/// frame that an image is of.
fn restore(
    map: &mut DenseMap,
    snapshot: &Snapshot,
    parts: Vec<DepthPart>,
    own: impl Fn(&Place) -> Option<KeyFrameId>,
) -> (Restored, Vec<DepthPart>) {
    let (mut restored, mut others) = (Restored::default(), Vec::new());
    let mut submaps: Vec<(Place, Vec<SavedDepth>)> = Vec::new();
    for part in parts {
        if (part.camera, part.metres_per_unit) != map.camera() {
            restored.other_camera += part.images.len();
            others.push(part);
            continue;
        }
        // A large submap is saved in several parts, one after the other.
        match submaps.last_mut().filter(|(submap, _)| *submap == part.submap) {
            Some((_, images)) => images.extend(part.images),
            None => submaps.push((part.submap, part.images)),
        }
    }
    let size = [map.camera().0.width, map.camera().0.height];
    for (submap, images) in submaps {
        let count = images.len();
        let added = submap_of(snapshot, &submap, images, size, &own)
            .and_then(|submap| Some((submap.frames.len(), map.restore(submap).ok()?)));
        let kept = added.map_or(0, |(kept, ())| kept);
        restored.submaps += usize::from(kept > 0);
        restored.images += kept;
        restored.lost += count - kept;
    }
    (restored, others)
}

/// A submap with those of its images whose key frames are in the same map.
fn submap_of(
    snapshot: &Snapshot,
    submap: &Place,
    images: Vec<SavedDepth>,
    [width, height]: [usize; 2],
    own: &impl Fn(&Place) -> Option<KeyFrameId>,
) -> Option<SavedSubmap> {
    let frame = |image: SavedDepth| {
        let (anchor, anchor_from_camera) = resolved(snapshot, &image.place)?;
        let gray = (!image.gray.is_empty()).then(|| PackedGray::from_bytes(width, height, image.gray));
        let depth = PackedDepth::from_bytes(width, height, image.packed);
        Some((anchor, anchor_from_camera, own(&image.place), depth, gray))
    };
    let frames: Vec<_> = images.into_iter().filter_map(frame).collect();
    // Where a submap's own frame is does not matter.
    let place = resolved(snapshot, submap).or_else(|| Some((frames.first()?.0, Se3::identity())));
    let (root, anchor_from_submap) = place?;
    let map_of = |id: KeyFrameId| snapshot.key_frame(id).map(|k| k.map);
    let frames: Vec<SavedFrame> = frames
        .into_iter()
        .filter(|(id, ..)| map_of(*id) == map_of(root))
        .map(|(id, anchor_from_camera, own, depth, gray)| SavedFrame {
            key_frame: own.map(anchor),
            anchor: anchor(id),
            anchor_from_camera,
            depth,
            gray,
        })
        .collect();
    (!frames.is_empty()).then(|| SavedSubmap { anchor: anchor(root), anchor_from_submap, frames })
}

/// The key frame that has taken over what was anchored to this place, and the pose there.
fn resolved(snapshot: &Snapshot, place: &Place) -> Option<(KeyFrameId, Se3)> {
    let id = snapshot.key_frame_named(place.key_frame)?;
    let (alive, alive_from_it) = snapshot.surviving_ancestor(id)?;
    let rigid = Se3::new(alive_from_it.rotation, alive_from_it.translation);
    Some((alive, rigid * place.key_frame_from_it))
}
