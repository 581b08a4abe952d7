//! The stream of map changes as an iterator.

use cairn_atlas::{Published, Snapshot, Subscription};
use std::sync::Arc;

/// All changes of the map since [`crate::Slam::changes`], commit by commit, none left out.
///
/// The iterator gives what has been committed so far and then `None`; iterate again (`for change in &mut changes`)
/// after further frames. What is not read stays in memory: drop it when it is no longer wanted.
#[derive(Debug)]
pub struct Changes(Subscription);

impl Changes {
    pub(crate) fn new(subscription: Subscription) -> Self {
        Self(subscription)
    }

    /// The map that the first change applies to.
    pub fn start(&self) -> &Arc<Snapshot> {
        &self.0.start
    }
}

impl Iterator for Changes {
    type Item = Arc<Published>;

    fn next(&mut self) -> Option<Self::Item> {
        self.0.changes.try_recv().ok()
    }
}
