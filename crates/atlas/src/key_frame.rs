//! A frame that stays.

use crate::{InertialState, KeyFrameId, LandmarkId, MapId};
use cairn_geometry::{Se3, Sim3};
use cairn_vision::Frame;
use cairn_vision::bow::Bag;
use std::sync::Arc;

/// A key frame: features, where they were seen from, and what they show.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Its name.
    pub id: KeyFrameId,
    /// Its features, never changed.
    pub frame: Arc<Frame>,
    /// The world it stands in (set by the map: its parent's, or one of its own).
    pub map: MapId,
    /// The words of its features, by which the place is found again; empty where it is not to be found.
    pub bag: Arc<Bag>,
    /// Where the eye was.
    pub world_from_camera: Se3,
    /// How many world units one unit of length is here that was one when the key frame was born: 1 until a map without
    /// metric scale is corrected. What hangs on a key frame keeps its lengths in the unit of its birth.
    pub unit: f64,
    /// For each feature the landmark it shows.
    pub landmarks: Vec<Option<LandmarkId>>,
    /// Its parent in the spanning tree; none for the root of a world.
    pub parent: Option<KeyFrameId>,
    /// Key frames at which a loop was closed with this one.
    pub links: Vec<KeyFrameId>,
    /// How the eye moved there, where an inertial sensor felt it.
    pub motion: Option<InertialState>,
    /// Key frames that share landmarks, with how many, most first (derived by the map).
    pub covisible: Vec<(KeyFrameId, u32)>,
}

impl KeyFrame {
    /// A key frame that shows no landmark yet, and that has no words; see [`KeyFrame::with_bag`].
    pub fn new(
        id: KeyFrameId,
        frame: Arc<Frame>,
        world_from_camera: Se3,
        parent: Option<KeyFrameId>,
    ) -> Self {
        let landmarks = vec![None; frame.len()];
        Self {
            id,
            frame,
            bag: Arc::default(),
            map: MapId(id),
            world_from_camera,
            unit: 1.0,
            landmarks,
            parent,
            links: Vec::new(),
            motion: None,
            covisible: Vec::new(),
        }
    }

    /// The pose with the unit: what hangs here with `camera_from_it` stands at `world_from_here() * camera_from_it`.
    pub fn world_from_here(&self) -> Sim3 {
        Sim3::new(self.world_from_camera.rotation, self.world_from_camera.translation, self.unit)
    }

    /// The same with the words of its features.
    pub fn with_bag(self, bag: Arc<Bag>) -> Self {
        Self { bag, ..self }
    }
}
