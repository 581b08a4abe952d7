//! What a server that takes the place of one that died must know: who holds the walk, and what is being done on it.

use cairn_session::WalkState;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// It, as it is in the file.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Survives {
    /// The secret of the page that holds the walk.
    pub holder: Option<String>,
    /// What is being done.
    pub walk: WalkState,
}

/// The file, which is written when something has changed.
pub(crate) struct SurvivesIn {
    path: PathBuf,
    written: Survives,
}

/// What the server before has left; nothing where there was none.
pub(crate) fn read(path: &Path) -> Survives {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    serde_json::from_str(&text).unwrap_or_default()
}

impl SurvivesIn {
    pub fn new(path: PathBuf) -> Self {
        let written = read(&path);
        Self { path, written }
    }

    /// What was being done on the walk before.
    pub fn before(&self) -> WalkState {
        self.written.walk.clone()
    }

    /// Writes it where it has changed. What cannot be written now is tried again at the next change.
    pub fn keep(&mut self, now: Survives) {
        if now == self.written {
            return;
        }
        let beside = self.path.with_extension("new");
        let text = serde_json::to_string(&now).unwrap_or_default();
        if std::fs::write(&beside, text).and_then(|()| std::fs::rename(&beside, &self.path)).is_ok() {
            self.written = now;
        }
    }
}
