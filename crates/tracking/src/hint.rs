//! Where the camera is said to be: a hint for relocalisation, which never counts without an image that confirms it.
//!
//! In: a pose in a map, with how far it may be off. While the hint holds, key frames near it are tried in every frame, whether
//! tracking is lost or not, and no place far from it is recognised. It ends when an image confirms it, when the pose that
//! tracking has agrees with it, or after [`HINT_S`] in which nothing near it was recognised.

use crate::recover::{GROUP, SIMILAR};
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_sensor::Stamp;
use cairn_vision::bow::Vocabulary;
use cairn_vision::{Frame, RectifiedCamera};

/// Seconds of images after which a hint that none has confirmed is given up.
const HINT_S: f64 = 10.0;
/// Key frames near the hint that are tried in turn, two in a frame: of one that stands still each gets another chance.
const NEAR: usize = 24;
/// How many radii around the hint key frames may be: a place is seen from elsewhere too.
const REACH: f64 = 3.0;

/// Where the camera is said to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaceHint {
    /// The map.
    pub map: MapId,
    /// The camera there, in the unit of the map.
    pub world_from_camera: Se3,
    /// How far off its position may be, in the unit of the map.
    pub radius: f64,
    /// A direction, of length 1 in the map, along which nothing is said of the position: up, for a place on a floor plan.
    pub free: Option<Vec3>,
}

/// What has become of a hint.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HintOutcome {
    /// No image has confirmed it yet.
    Searching,
    /// The pose that tracking had is within its radius.
    Agrees,
    /// An image has confirmed a place within its radius: tracking goes on there.
    Recognised,
    /// It was given up.
    NotRecognised {
        /// The most matches that agreed on a place near it, and how many are needed.
        inliers: usize,
        /// See `inliers`.
        need: usize,
        /// Key frames of the map near it.
        key_frames: usize,
    },
}

/// The hint at hand, with the images since it was given.
#[derive(Debug, Default)]
pub(crate) struct Hinted {
    hint: Option<PlaceHint>,
    since: Option<Stamp>,
    frames: usize,
    best: usize,
    outcome: Option<HintOutcome>,
}

impl Hinted {
    /// Takes a hint in place of the one before.
    pub fn give(&mut self, hint: PlaceHint) {
        *self = Self { hint: Some(hint), outcome: Some(HintOutcome::Searching), ..Self::default() };
    }

    /// What has become of the last hint; `None` where there was none.
    pub fn outcome(&self) -> Option<HintOutcome> {
        self.outcome
    }

    /// Whether a place may be recognised: it is not one that a hint speaks against.
    pub fn allows(&self, map: Option<MapId>, world_from_camera: &Se3) -> bool {
        self.hint.is_none_or(|hint| map == Some(hint.map) && hint.is_near(world_from_camera, 1.0))
    }

    /// Key frames to try in a frame while a hint holds: near it in turn, and those most similar among all near it. `at` is the pose
    /// that tracking has.
    pub fn candidates(
        &mut self,
        snapshot: &Snapshot,
        camera: &RectifiedCamera,
        frame: &Frame,
        at: Option<(MapId, Se3)>,
        need: usize,
    ) -> Vec<KeyFrameId> {
        let Some(hint) = self.hint else { return Vec::new() };
        if at.is_some_and(|(map, pose)| self.allows(Some(map), &pose)) {
            self.end(HintOutcome::Agrees);
            return Vec::new();
        }
        let fits = |k: &KeyFrame| hint.is_near(&k.world_from_camera, REACH) && k.map == hint.map;
        let fits = |k: &KeyFrame| fits(k) && (!camera.has_depth() || snapshot.is_metric_in(k.map, camera));
        let mut near: Vec<(f64, KeyFrameId)> =
            snapshot.key_frames_of(hint.map).filter(|k| fits(k)).map(|k| (hint.off(k), k.id)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
        let since = *self.since.get_or_insert(frame.stamp);
        if frame.stamp - since > HINT_S || near.is_empty() {
            self.end(HintOutcome::NotRecognised { inliers: self.best, need, key_frames: near.len() });
            return Vec::new();
        }
        let turn = 2 * self.frames;
        self.frames += 1;
        let most = near.len().min(NEAR);
        let mut found = vec![near[turn % most].1];
        found.extend(Some(near[(turn + 1) % most].1).filter(|id| *id != found[0]));
        let bag = Vocabulary::current().bag(&frame.descriptors);
        let fits = |id: KeyFrameId| snapshot.key_frame(id).is_some_and(fits);
        let similar = snapshot.similar_key_frames(&bag, SIMILAR, GROUP, &[], fits);
        let similar = similar.into_iter().map(|(id, _)| id).filter(|id| !found.contains(id));
        let similar: Vec<KeyFrameId> = similar.collect();
        found.extend(similar);
        found
    }

    /// So many matches agreed on a place that was tried.
    pub fn tried(&mut self, inliers: usize) {
        self.best = self.best.max(inliers);
    }

    /// A place was recognised that the hint allows.
    pub fn confirm(&mut self) {
        if self.hint.is_some() {
            self.end(HintOutcome::Recognised);
        }
    }

    fn end(&mut self, outcome: HintOutcome) {
        (self.hint, self.outcome) = (None, Some(outcome));
    }
}

impl PlaceHint {
    fn is_near(&self, world_from_camera: &Se3, radii: f64) -> bool {
        self.distance(world_from_camera) <= radii * self.radius
    }

    fn distance(&self, world_from_camera: &Se3) -> f64 {
        let off = world_from_camera.translation - self.world_from_camera.translation;
        self.free.map_or(off, |free| off - free * free.dot(&off)).norm()
    }

    /// How well a key frame fits: distance in radii, and a radius for each radian.
    fn off(&self, key_frame: &KeyFrame) -> f64 {
        let turned = self.world_from_camera.rotation.inverse() * key_frame.world_from_camera.rotation;
        self.distance(&key_frame.world_from_camera) / self.radius + turned.angle()
    }
}
