//! The dense map as it is saved: depth with the poses it is anchored with; the volumes are fused again from it.

use super::{AnchoredPose, DenseMap, Kept, PackedDepth, PackedGray};
use crate::{AnchorId, DenseError, MapId};
use cairn_geometry::Se3;

/// The depth of a key frame.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedFrame {
    /// The key frame that it is of, where that is known: [`DenseMap::forget`] drops no other.
    pub key_frame: Option<AnchorId>,
    /// The key frame that it is anchored to: its own, or the one that took over.
    pub anchor: AnchorId,
    /// Pose of the depth camera in the frame of that key frame.
    pub anchor_from_camera: Se3,
    /// The image.
    pub depth: PackedDepth,
    /// What the same pixels look like.
    pub gray: Option<PackedGray>,
}

/// A submap without its volumes.
#[derive(Clone, Debug, PartialEq)]
pub struct SavedSubmap {
    /// The key frame that it is anchored to.
    pub anchor: AnchorId,
    /// Its pose in the frame of that key frame.
    pub anchor_from_submap: Se3,
    /// Its frames, oldest first.
    pub frames: Vec<SavedFrame>,
}

impl DenseMap {
    /// What is to be saved, oldest submap first. No pixels are copied.
    pub fn saved(&self) -> Vec<SavedSubmap> {
        let frame = |k: &Kept| SavedFrame {
            key_frame: k.key_frame,
            anchor: k.anchored.anchor,
            anchor_from_camera: k.anchored.pose,
            depth: k.depth.clone(),
            gray: k.gray.clone(),
        };
        let submaps = self.submaps.iter().enumerate().filter_map(|(i, s)| Some((i, s.as_ref()?.anchored)));
        let saved = submaps.map(|(index, anchored)| SavedSubmap {
            anchor: anchored.anchor,
            anchor_from_submap: anchored.pose,
            frames: self.kept.iter().filter(|k| k.target == index).map(frame).collect(),
        });
        saved.filter(|s| !s.frames.is_empty()).collect()
    }

    /// Adds a saved submap, whose anchors are known already ([`DenseMap::add_anchor`]). Its frames count at once in
    /// [`DenseMap::fuse_all`]; its volumes are fused by [`DenseMap::step`].
    ///
    /// # Errors
    /// An unknown anchor, a pose that is not finite, images of another size. The map is then unchanged.
    pub fn restore(&mut self, saved: SavedSubmap) -> Result<(), DenseError> {
        let camera = *self.preparer.camera();
        let known = |anchor: AnchorId| self.anchors.get(&anchor).ok_or(DenseError::UnknownAnchor(anchor.0));
        let map = known(saved.anchor)?.map;
        let mut finite = saved.anchor_from_submap.is_finite();
        for frame in &saved.frames {
            known(frame.anchor)?;
            finite &= frame.anchor_from_camera.is_finite();
            let gray = frame.gray.as_ref().map(PackedGray::size);
            for [width, height] in [frame.depth.size()].into_iter().chain(gray) {
                let [expected_width, expected_height] = [camera.width, camera.height];
                if [width, height] == [expected_width, expected_height] {
                    continue;
                }
                return Err(DenseError::Size {
                    what: "an image",
                    width,
                    height,
                    expected_width,
                    expected_height,
                });
            }
        }
        if !finite {
            return Err(DenseError::Pose("a number is not finite".into()));
        }
        let index = self.submaps.len();
        let anchored = AnchoredPose { anchor: saved.anchor, pose: saved.anchor_from_submap };
        self.added += 1;
        let submap = self.empty_submap(anchored)?;
        self.submaps.push(Some(submap));
        self.active.entry(map).or_insert(index);
        for frame in saved.frames {
            self.waiting.push(self.kept.len());
            let anchored = AnchoredPose { anchor: frame.anchor, pose: frame.anchor_from_camera };
            self.kept.push(Kept {
                key_frame: frame.key_frame,
                anchored,
                inside: None,
                target: index,
                depth: frame.depth,
                gray: frame.gray,
            });
        }
        Ok(())
    }

    /// How many images a map has.
    pub fn images_of(&self, map: MapId) -> usize {
        let of = |k: &&Kept| self.anchors.get(&k.anchored.anchor).is_some_and(|a| a.map == map);
        self.kept.iter().filter(of).count()
    }
}
