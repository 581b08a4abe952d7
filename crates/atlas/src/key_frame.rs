//! Key frames.

use crate::{InertialState, KeyFrameId, LandmarkId, MapId, OtherCamera, Paged, RelativePose};
use cairn_geometry::{Se3, Sim3};
use cairn_sensor::Stamp;
use cairn_vision::Frame;
use cairn_vision::bow::BagOfWords;
use std::sync::Arc;

/// A key frame: features, the pose they were seen from, and the landmarks they show.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Its id.
    pub id: KeyFrameId,
    /// When it was taken.
    pub stamp: Stamp,
    /// Its features, never changed; on disk where nobody looks at them. How many there are, `landmarks` tells.
    pub frame: Paged<Frame>,
    /// The map it belongs to (set on insertion: its parent's, or a new one).
    pub map: MapId,
    /// Its bag of words, for place recognition; empty where it shall not be found.
    pub bag: Paged<BagOfWords>,
    /// The pose of the camera.
    pub world_from_camera: Se3,
    /// Units of the map per unit of length at the time the key frame was created: 1 until a map without
    /// metric scale is corrected. What is anchored to a key frame keeps its lengths in that original unit.
    pub unit: f64,
    /// The landmark that each feature shows.
    pub landmarks: Vec<Option<LandmarkId>>,
    /// Its parent in the spanning tree; `None` for the root of a map.
    pub parent: Option<KeyFrameId>,
    /// Key frames connected to this one by loop closures.
    pub links: Vec<KeyFrameId>,
    /// Its pose relative to earlier key frames as depth measured it, in the order of these.
    pub relative_poses: Vec<RelativePose>,
    /// Its inertial state, where there is an IMU.
    pub motion: Option<InertialState>,
    /// The camera that made it, where that is not the atlas's.
    pub other_camera: Option<Arc<OtherCamera>>,
    /// Covisible key frames with the number of shared landmarks, most first (derived by the map).
    pub covisible: Vec<(KeyFrameId, u32)>,
    /// All that share landmarks with it (derived by the map).
    pub(crate) shares: Shares,
}

impl KeyFrame {
    /// A key frame without observations and without a bag of words; see [`KeyFrame::with_bag`].
    pub fn new(
        id: KeyFrameId,
        frame: Arc<Frame>,
        world_from_camera: Se3,
        parent: Option<KeyFrameId>,
    ) -> Self {
        let landmarks = vec![None; frame.len()];
        Self {
            id,
            stamp: frame.stamp,
            frame: frame.into(),
            bag: Paged::default(),
            map: MapId(id),
            world_from_camera,
            unit: 1.0,
            landmarks,
            parent,
            links: Vec::new(),
            relative_poses: Vec::new(),
            motion: None,
            other_camera: None,
            covisible: Vec::new(),
            shares: Shares::default(),
        }
    }

    /// The pose with the unit: what is anchored here with `camera_from_it` has the pose `world_from_here() *
    /// camera_from_it`.
    pub fn world_from_here(&self) -> Sim3 {
        Sim3::new(self.world_from_camera.rotation, self.world_from_camera.translation, self.unit)
    }

    /// The pose of another key frame of its map in its camera frame, in its unit.
    pub fn here_from(&self, other: &KeyFrame) -> Se3 {
        let here_from = self.world_from_here().inverse() * other.world_from_here();
        Se3::new(here_from.rotation, here_from.translation)
    }

    /// Adds the bag of words of its features.
    pub fn with_bag(self, bag: Arc<BagOfWords>) -> Self {
        Self { bag: bag.into(), ..self }
    }
}

/// All key frames that share landmarks with one, in order, with how many; `None` where they were not counted since the map was
/// opened. The landmarks tell the same, so it is not shown.
#[derive(Clone, Default)]
pub(crate) struct Shares(pub Option<Vec<(KeyFrameId, u32)>>);

impl std::fmt::Debug for Shares {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("as landmarks tell")
    }
}
