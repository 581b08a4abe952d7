//! What an engine and the search by depth for its lost camera tell each other, whatever thread that is on.

use cairn_atlas::MapId;
use cairn_geometry::Vec3;
use cairn_tracking::FoundByDepth;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// What an engine and a search by depth tell each other.
#[derive(Debug, Default)]
pub(crate) struct Exchange {
    /// Where the camera is, for the next frame.
    pub found: Option<FoundByDepth>,
    /// The direction against gravity in the camera, at the last frame.
    pub up: Option<Vec3>,
    /// The maps that are aligned with gravity, while tracking is lost.
    pub gravity_aligned: Vec<MapId>,
    /// Whether a place could be believed at present.
    pub is_of_use: bool,
    /// How often tracking went on where it was told to, and how often it did not.
    pub taken: [usize; 2],
}

/// A handle to it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Link(Arc<Mutex<Exchange>>);

impl Link {
    pub fn lock(&self) -> MutexGuard<'_, Exchange> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
