//! Seams: key frames of one map in which places of another are recognised, by words first and then by geometry.

use crate::closing::scales::DepthRatio;
use crate::closing::visits::with_gravity_of;
use crate::closing::{Closer, Freedom};
use cairn_adjust::{RecogniseConfig, Recognised, View, recognise};
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::Sim3;
use cairn_vision::{Frame, RectifiedCamera};
use std::collections::BTreeSet;

/// Seams that are judged, at most: of more, evenly chosen ones.
const MOST: usize = 400;

/// A place of the older map, recognised in a key frame of the younger one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Seam {
    /// The key frame of the younger map.
    pub key_frame: KeyFrameId,
    /// The key frame of the older map around which its landmarks are.
    pub place: KeyFrameId,
    /// Landmarks of the older map that are inliers.
    pub inliers: usize,
    /// Landmarks of the older map that should be in view.
    pub expected: usize,
    /// From the younger map to the older one, by this seam alone.
    pub into_from: Sim3,
}

/// A seam with what was recognised.
#[derive(Clone, Debug)]
pub(super) struct Found {
    pub seam: Seam,
    pub place: Recognised,
    /// Pose of the key frame in the older map; the scale is length there for each length here.
    pub world_from_here: Sim3,
    pub freedom: Freedom,
    /// What the points known in both maps say of the scale between them.
    pub depth_ratio: DepthRatio,
}

impl Found {
    /// The same where the younger map's lengths are multiplied by this first: the pose of the key frame in the older map is seen there,
    /// and stays.
    pub fn scale(&mut self, snapshot: &Snapshot, factor: f64) {
        let Some(here) = snapshot.key_frame(self.seam.key_frame) else { return };
        self.world_from_here.scale *= factor;
        self.seam.into_from = self.world_from_here * Sim3::from(here.world_from_camera).inverse();
    }
}

impl Closer {
    /// All seams between two maps, in the order of their key frames, and the number of key frames compared.
    pub(super) fn seams(&self, snapshot: &Snapshot, from: MapId, into: MapId) -> (usize, Vec<Found>) {
        let (mut compared, mut found) = (0, Vec::new());
        for here in snapshot.key_frames_of(from) {
            let in_older = |id: KeyFrameId| snapshot.key_frame(id).is_some_and(|k| k.map == into);
            let places =
                snapshot.similar_key_frames(&here.bag, self.config.candidates, usize::MAX, &[], in_older);
            compared += usize::from(!places.is_empty());
            found.extend(places.iter().filter_map(|(old, _)| self.seam(snapshot, here, *old)));
        }
        let (all, step) = (found.len(), found.len().div_ceil(MOST).max(1));
        let even = |(k, f)| (k % step == 0 || all <= MOST).then_some(f);
        (compared, found.into_iter().enumerate().filter_map(even).collect())
    }

    /// The seam between a key frame and a place of the other map, if it is recognised there.
    pub(super) fn seam(&self, snapshot: &Snapshot, here: &KeyFrame, old: KeyFrameId) -> Option<Found> {
        let config = RecogniseConfig { seed: self.config.need / 2, need: self.config.need, share: 0.5 };
        let (seed, known) = (here.id.index() as u64, BTreeSet::new());
        let mut view = View::of(&self.camera, here);
        // Measured depth is in metres, and would contradict landmarks in another unit.
        let metric = |k: &KeyFrame| snapshot.is_metric_in(k.map, &self.camera);
        let flat = (view.camera.has_depth() && !snapshot.key_frame(old).is_some_and(metric))
            .then(|| without_depth(&view));
        if let Some((frame, camera)) = &flat {
            view = View { frame, camera, ..view };
        }
        let place = recognise(snapshot, &view, old, &known, &config, seed).ok()?;
        let visits = self.visits(snapshot, here, old);
        let (freedom, depth_ratio) = (visits.freedom(), visits.depth_ratio(&place));
        let scale = visits.scale(&depth_ratio, self.config.need).ok()?;
        let there = place.world_from_camera;
        let mut world_from_here = Sim3::new(there.rotation, there.translation, scale);
        if freedom == Freedom::AlignGravity {
            world_from_here = with_gravity_of(here, &world_from_here).ok()?;
        }
        let seam = Seam {
            key_frame: here.id,
            place: old,
            inliers: place.inliers,
            expected: place.expected,
            into_from: world_from_here * Sim3::from(here.world_from_camera).inverse(),
        };
        Some(Found { seam, place, world_from_here, freedom, depth_ratio })
    }
}

/// The same frame as a single camera would have seen it.
fn without_depth(view: &View) -> (Frame, RectifiedCamera) {
    let mut frame = view.frame.clone();
    frame.right_x.fill(f32::NAN);
    frame.depth.fill(f32::NAN);
    (frame, RectifiedCamera { baseline_fx: 0.0, ..*view.camera })
}
