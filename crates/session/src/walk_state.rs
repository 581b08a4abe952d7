//! What is being done on a walk, for a session that goes on with it in another process.

use cairn_guide::Facing;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What is being done on a walk.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct WalkState {
    /// The identity of the atlas, where it is kept.
    pub atlas: Option<String>,
    /// The file of the recording in progress.
    pub recording: Option<PathBuf>,
    /// That recording began by itself.
    pub is_auto: bool,
    /// None begins by itself any more.
    pub auto_recorded: bool,
    /// The file of the route at hand.
    pub route: Option<PathBuf>,
    /// Guidance along it is in progress: where the walker faces, and whether again from its start.
    pub guiding: Option<(Facing, bool)>,
    /// The walker has paused it.
    #[serde(default)]
    pub is_paused: bool,
}
