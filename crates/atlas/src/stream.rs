//! The stream of changes: what every commit did, told in order to all who listen.

use crate::{Change, KeyFrameId, Snapshot};
use cairn_geometry::Sim3;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// What one commit did.
#[derive(Clone, Debug)]
pub struct Published {
    /// The version that it made.
    pub version: u64,
    /// The changes that were done, in order, as they were applied: after rebasing, without those that were dropped. Landmarks
    /// that nobody sees any more go without being named.
    pub changes: Vec<Change>,
    /// For each removed key frame among them, in order, what hangs on whom from now on.
    pub removed: Vec<Removed>,
}

/// A removed key frame: what hung on it hangs on its parent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Removed {
    /// The key frame that is gone.
    pub key_frame: KeyFrameId,
    /// Its parent when it went.
    pub parent: KeyFrameId,
    /// Where it stood there, with the ratio of their units.
    pub parent_from_it: Sim3,
}

/// The stream from some version on.
#[derive(Debug)]
pub struct Subscription {
    /// The map as it was when the stream began.
    pub start: Arc<Snapshot>,
    /// Every commit since, in order.
    pub changes: Receiver<Arc<Published>>,
}

/// Those who listen.
#[derive(Debug, Default)]
pub(crate) struct Subscribers(Vec<Sender<Arc<Published>>>);

impl Subscribers {
    pub fn subscribe(&mut self, start: Arc<Snapshot>) -> Subscription {
        let (to, changes) = channel();
        self.0.push(to);
        Subscription { start, changes }
    }

    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Tells all; who is gone is forgotten. `next` is the map that the changes made.
    pub fn publish(&mut self, changes: Vec<Change>, next: &Snapshot) {
        let gone = |id: KeyFrameId| {
            let (parent, parent_from_it) = *next.gone.get(id.index())?;
            Some(Removed { key_frame: id, parent, parent_from_it })
        };
        let removed = changes.iter().filter_map(|change| match change {
            Change::RemoveKeyFrame(id) => gone(*id),
            _ => None,
        });
        let removed = removed.collect();
        let published = Arc::new(Published { version: next.version, changes, removed });
        self.0.retain(|to| to.send(published.clone()).is_ok());
    }
}
