//! Landmarks: points of the world that are observed in key frames.

use crate::{KeyFrameId, LandmarkId};
use cairn_geometry::Vec3;
use cairn_vision::Descriptor;

/// A feature of a key frame that shows a landmark.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Observation {
    /// The key frame.
    pub key_frame: KeyFrameId,
    /// The feature's index in the key frame's [`cairn_vision::Frame`].
    pub feature: u16,
}

/// A landmark. All fields but `id`, `position` and `observations` are derived from the observations by the
/// map.
#[derive(Clone, Debug)]
pub struct Landmark {
    /// Its id.
    pub id: LandmarkId,
    /// Position in the world frame of its map, in map units (metres where the map is metric).
    pub position: Vec3,
    /// The pyramid level of its first observation.
    pub octave: u8,
    /// The angle of its latest observation.
    pub angle: f32,
    /// Which observation gave its descriptor.
    pub(crate) pick: u16,
    /// Its observations, ordered by key frame.
    pub observations: Vec<Observation>,
    /// Mean viewing direction from the observing cameras to it, unit length.
    pub normal: Vec3,
    /// The observed descriptor with the least median Hamming distance to the others.
    pub descriptor: Descriptor,
    /// Smallest distance in map units at which the feature detector would still find it with the atlas's camera, at its
    /// coarsest level.
    pub min_distance: f64,
    /// Greatest distance at which it would be found, at the finest level.
    pub max_distance: f64,
}

impl Landmark {
    /// A landmark without observations; the map derives the rest when they are added.
    pub fn new(id: LandmarkId, position: Vec3) -> Self {
        Self {
            id,
            position,
            octave: 0,
            angle: 0.0,
            pick: 0,
            observations: Vec::new(),
            normal: Vec3::zeros(),
            descriptor: [0; 32],
            min_distance: 0.0,
            max_distance: 0.0,
        }
    }

    /// The feature that shows this landmark in a key frame.
    pub fn feature_in(&self, key_frame: KeyFrameId) -> Option<u16> {
        self.observations
            .binary_search_by_key(&key_frame, |o| o.key_frame)
            .ok()
            .map(|i| self.observations[i].feature)
    }
}
