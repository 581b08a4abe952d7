//! A draft of the map to which changes are applied one after the other, so that later ones build on earlier ones; all
//! are returned as one list.

use cairn_atlas::{Change, ChangeSet, Snapshot};

/// The draft so far and the changes that led to it.
pub(super) struct Draft {
    snapshot: Snapshot,
    changes: Vec<Change>,
}

impl Draft {
    pub fn new(snapshot: &Snapshot) -> Self {
        Self { snapshot: snapshot.clone(), changes: Vec::new() }
    }

    /// The snapshot with all changes so far.
    pub fn snapshot(&self) -> &Snapshot {
        &self.snapshot
    }

    pub fn push(&mut self, changes: Vec<Change>) {
        if !changes.is_empty() {
            let set = ChangeSet { base: self.snapshot.version(), changes };
            self.snapshot = self.snapshot.apply(&set).0;
            self.changes.extend(set.changes);
        }
    }

    pub fn into_changes(self) -> Vec<Change> {
        self.changes
    }

    /// The snapshot with all changes, and these.
    pub fn into_parts(self) -> (Snapshot, Vec<Change>) {
        (self.snapshot, self.changes)
    }
}
