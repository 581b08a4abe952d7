//! The map that SLAM in another process makes, as its journal tells it.

use crate::JournalError;
use crate::journal::Tail;
use cairn_atlas::Snapshot;
use cairn_atlas::store::MapFile;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// The map as far as the journal was read.
pub(super) struct FollowedMap {
    /// The map before the journal is followed, and its provenance.
    base: MapFile,
    tail: Option<Tail>,
    pub(super) snapshot: Arc<Snapshot>,
}

impl FollowedMap {
    /// Before anything was read.
    pub(super) fn new(base: MapFile) -> Self {
        Self { snapshot: Arc::new(base.snapshot.clone()), base, tail: None }
    }

    /// Reads what SLAM has written into this folder since.
    pub(super) fn follow(&mut self, folder: &Path) -> Result<(), JournalError> {
        match &mut self.tail {
            Some(tail) => tail.follow()?,
            None => self.tail = Tail::open(folder)?,
        }
        if let Some(tail) = &self.tail
            && tail.map().version() != self.snapshot.version()
        {
            self.snapshot = Arc::new(tail.map().clone());
        }
        Ok(())
    }

    /// The map as a file of this program.
    pub(super) fn to_save(&self, program: &str, attached: BTreeMap<String, Vec<u8>>) -> MapFile {
        let file = self.tail.as_ref().map_or(&self.base, Tail::file);
        let mut about = file.about.clone();
        program.clone_into(&mut about.program);
        MapFile { snapshot: file.snapshot.clone(), about, attached }
    }
}
