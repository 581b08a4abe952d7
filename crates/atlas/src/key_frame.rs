//! A frame that stays.

use crate::{KeyFrameId, LandmarkId};
use cairn_geometry::Se3;
use cairn_vision::Frame;
use std::sync::Arc;

/// A key frame: features, where they were seen from, and what they show.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Its name.
    pub id: KeyFrameId,
    /// Its features, never changed.
    pub frame: Arc<Frame>,
    /// Where the eye was.
    pub world_from_eye: Se3,
    /// For each feature the landmark it shows.
    pub landmarks: Vec<Option<LandmarkId>>,
    /// Its parent in the spanning tree; none for the first.
    pub parent: Option<KeyFrameId>,
    /// Key frames that share landmarks, with how many, most first (derived by the map).
    pub covisible: Vec<(KeyFrameId, u32)>,
}

impl KeyFrame {
    /// A key frame that shows no landmark yet.
    pub fn new(id: KeyFrameId, frame: Arc<Frame>, world_from_eye: Se3, parent: Option<KeyFrameId>) -> Self {
        let landmarks = vec![None; frame.len()];
        Self { id, frame, world_from_eye, landmarks, parent, covisible: Vec::new() }
    }
}
