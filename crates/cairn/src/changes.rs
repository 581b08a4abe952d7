//! The stream of map changes as an iterator.

use cairn_atlas::{Published, Snapshot, Subscription};
use std::sync::Arc;

/// All changes of the map since [`crate::Slam::changes`], commit by commit, none left out.
///
/// The iterator gives what has been committed so far and then `None`; iterate again (`for change in &mut changes`)
/// after further frames. What is not read stays in memory ([`Changes::behind`] says how much that is): drop it when it is no
/// longer wanted.
#[derive(Debug)]
pub struct Changes {
    from: Subscription,
    version: u64,
}

impl Changes {
    pub(crate) fn new(subscription: Subscription) -> Self {
        Self { version: subscription.start.version(), from: subscription }
    }

    /// The map that the first change applies to.
    pub fn start(&self) -> &Arc<Snapshot> {
        &self.from.start
    }

    /// How many commits wait to be read.
    pub fn behind(&self) -> u64 {
        self.from.behind(self.version)
    }
}

impl Iterator for Changes {
    type Item = Arc<Published>;

    fn next(&mut self) -> Option<Self::Item> {
        let published = self.from.changes.try_recv().ok()?;
        self.version = published.version;
        Some(published)
    }
}
