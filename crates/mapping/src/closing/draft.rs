//! A map on which changes are tried one after the other, so that later ones build on earlier ones; all are handed back
//! as one list.

use cairn_atlas::{Change, ChangeSet, Map};

/// The map so far and what was done to it.
pub(super) struct Draft {
    map: Map,
    changes: Vec<Change>,
}

impl Draft {
    pub fn new(map: &Map) -> Self {
        Self { map: map.clone(), changes: Vec::new() }
    }

    /// The map with all changes so far.
    pub fn map(&self) -> &Map {
        &self.map
    }

    pub fn push(&mut self, changes: Vec<Change>) {
        if !changes.is_empty() {
            let set = ChangeSet { base: self.map.version(), changes };
            self.map = self.map.apply(&set).0;
            self.changes.extend(set.changes);
        }
    }

    pub fn into_changes(self) -> Vec<Change> {
        self.changes
    }
}
