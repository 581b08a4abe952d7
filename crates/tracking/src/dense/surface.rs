//! The surface in view, as far as the pose of the next image needs it: a field fused from the depth images of a few
//! earlier frames, in the frame of one key frame.
//!
//! While features carry the pose nothing is fused: the images are only remembered, with their poses. The field is built from
//! them when it is asked for, and once it has grown too large.

use super::texture::View;
use crate::state::AnchoredPose;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_dense::{DepthFrame, DepthPreparer, TsdfConfig, TsdfVolume};
use cairn_geometry::{Manifold, Se3};
use cairn_sensor::{DepthImage, GrayImage};
use std::collections::VecDeque;
use std::sync::Arc;

/// Images that are remembered.
const REMEMBERED: usize = 8;
/// An image is remembered when the camera has moved by so many metres and radians (together) since the last that was.
const APART: f64 = 0.12;
/// The texture seen by a camera at most so many metres and radians (together) from here is compared with what is seen now.
const ALIKE: f64 = 0.4;
/// The field is built anew once the camera is so many metres from where it was built.
const FAR_M: f64 = 4.0;

/// A depth image, the gray image of its pixels, and where it was taken.
#[derive(Clone, Debug)]
struct Taken {
    image: Arc<DepthImage>,
    gray: Option<Arc<GrayImage>>,
    anchored: AnchoredPose,
}

/// The field is built anew after so many images, so that it forgets what has changed.
const MOST_IMAGES: usize = 2000;

/// The field in the camera frame of a key frame.
struct Field {
    volume: TsdfVolume,
    reference: KeyFrameId,
    /// Where the camera was when it was built, in that frame.
    built_at: Se3,
    /// Images fused since then.
    images: usize,
}

/// The images and the field.
#[derive(Default)]
pub(super) struct Surface {
    remembered: VecDeque<Taken>,
    latest: Option<Taken>,
    field: Option<Field>,
}

impl Surface {
    /// A frame with a pose has come: its image is the latest, and remembered where the view has changed.
    pub fn take(&mut self, image: Arc<DepthImage>, gray: Option<Arc<GrayImage>>, anchored: AnchoredPose) {
        let moved = |t: &Taken| t.anchored.world_from_camera.local(&anchored.world_from_camera).norm();
        let same_place = self.remembered.back().is_some_and(|t| moved(t) < APART);
        let taken = Taken { image, gray, anchored };
        if !same_place {
            if self.remembered.len() == REMEMBERED {
                self.remembered.pop_front();
            }
            self.remembered.push_back(taken.clone());
        }
        self.latest = Some(taken);
    }

    /// The oldest remembered view from near `reference_from_camera` that has a gray image, so that errors do not add up from frame to frame,
    /// and its pose in the camera frame of the reference.
    pub fn view_of(
        &self,
        snapshot: &Snapshot,
        reference: KeyFrameId,
        reference_from_camera: &Se3,
    ) -> Option<(View, Se3)> {
        self.remembered.iter().find_map(|taken| {
            let view = View { depth: taken.image.clone(), gray: taken.gray.clone()? };
            let pose = in_reference(snapshot, reference, &taken.anchored)?;
            (pose.local(reference_from_camera).norm() < ALIKE).then_some((view, pose))
        })
    }

    /// Forgets the field, not the images.
    pub fn forget_field(&mut self) {
        self.field = None;
    }

    /// Forgets everything: what is seen next belongs elsewhere.
    pub fn clear(&mut self) {
        *self = Self::default();
    }

    /// Makes the field ready for a camera near `world_from_camera`: the key frame whose camera frame it is in. It is built if need
    /// be; `None` before any image was taken.
    pub fn ready(
        &mut self,
        snapshot: &Snapshot,
        world_from_camera: &Se3,
        preparer: &mut DepthPreparer,
        camera_from_depth: &Se3,
    ) -> Option<KeyFrameId> {
        let is_near = |f: &Field| {
            let here = snapshot.anchor(f.reference, world_from_camera)?;
            let is_far = (here.translation - f.built_at.translation).norm() >= FAR_M;
            (!is_far && f.images < MOST_IMAGES).then_some(())
        };
        if self.field.as_ref().and_then(is_near).is_none() {
            self.field = self.build(snapshot, preparer, camera_from_depth);
        }
        self.field.as_ref().map(|f| f.reference)
    }

    /// The field, where there is one.
    pub fn volume(&self) -> Option<&TsdfVolume> {
        self.field.as_ref().map(|f| &f.volume)
    }

    fn build(
        &self,
        snapshot: &Snapshot,
        preparer: &mut DepthPreparer,
        camera_from_depth: &Se3,
    ) -> Option<Field> {
        let latest = self.latest.as_ref()?;
        let (reference, _) = snapshot.surviving_ancestor(latest.anchored.reference)?;
        let mut volume = TsdfVolume::new(TsdfConfig::default()).ok()?;
        let built_at = in_reference(snapshot, reference, &latest.anchored)?;
        let newest = self.remembered.back().filter(|t| !Arc::ptr_eq(&t.image, &latest.image));
        let all = self.remembered.iter().rev().skip(usize::from(newest.is_none()));
        for taken in std::iter::once(latest).chain(all) {
            let Some(pose) = in_reference(snapshot, reference, &taken.anchored) else { continue };
            let Ok(frame) = preparer.prepare(&taken.image) else { continue };
            // An image that cannot be fused is left out.
            let _ = volume.integrate(frame, None, &(pose * *camera_from_depth));
        }
        Some(Field { volume, reference, built_at, images: 0 })
    }

    /// Adds an image to the field, if there is one.
    pub fn fuse(&mut self, snapshot: &Snapshot, frame: &DepthFrame, world_from_depth: &Se3) {
        let Some(field) = &mut self.field else { return };
        let Some(pose) = snapshot.anchor(field.reference, world_from_depth) else { return };
        // An image that cannot be fused is left out.
        let _ = field.volume.integrate(frame, None, &pose);
        field.images += 1;
    }
}

/// A pose of the map in the camera frame of a key frame.
fn in_reference(snapshot: &Snapshot, reference: KeyFrameId, anchored: &AnchoredPose) -> Option<Se3> {
    let world = snapshot.resolve(anchored.reference, &anchored.reference_from_camera)?;
    snapshot.anchor(reference, &world)
}
