//! The stream of changes: the effect of every commit, sent in order to all subscribers.

use crate::{Change, KeyFrameId, Snapshot};
use cairn_geometry::Sim3;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};

/// The effect of one commit.
#[derive(Clone, Debug)]
pub struct Published {
    /// The version it produced.
    pub version: u64,
    /// The changes that were applied, in order: after rebasing, without those that were dropped. The removal
    /// of landmarks that lost their last observation is not listed.
    pub changes: Vec<Change>,
    /// For each removed key frame among them, in order, the parent that takes over what was anchored to it.
    pub removed: Vec<Removed>,
}

/// A removed key frame: what was anchored to it is anchored to its parent from now on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Removed {
    /// The removed key frame.
    pub key_frame: KeyFrameId,
    /// Its parent at the time.
    pub parent: KeyFrameId,
    /// Its pose in the parent's camera frame, with the ratio of their units.
    pub parent_from_it: Sim3,
}

/// A subscription to the stream, from some version on.
#[derive(Debug)]
pub struct Subscription {
    /// The snapshot at which the stream starts.
    pub start: Arc<Snapshot>,
    /// Every commit since, in order.
    pub changes: Receiver<Arc<Published>>,
    latest: Arc<AtomicU64>,
}

impl Subscription {
    /// How many commits there are after the one that produced this version. What is not read stays in memory: a reader
    /// that falls far behind drops the subscription and subscribes again.
    pub fn behind(&self, version: u64) -> u64 {
        self.latest.load(Ordering::Acquire).saturating_sub(version)
    }
}

/// The other end of a subscription whose commits come from elsewhere, a journal for instance, in place of an
/// [`crate::Atlas`].
#[derive(Debug)]
pub struct Feed {
    to: Sender<Arc<Published>>,
    latest: Arc<AtomicU64>,
}

impl Feed {
    /// A subscription that starts at a snapshot, and the end where its commits are put in.
    pub fn new(start: Arc<Snapshot>) -> (Self, Subscription) {
        let (to, changes) = channel();
        let latest = Arc::new(AtomicU64::new(start.version));
        (Self { to, latest: latest.clone() }, Subscription { start, changes, latest })
    }

    /// Puts in the next commit; false when the subscriber is gone.
    pub fn put(&self, commit: Published) -> bool {
        self.latest.fetch_max(commit.version, Ordering::AcqRel);
        self.to.send(Arc::new(commit)).is_ok()
    }
}

/// The senders of all subscriptions.
#[derive(Debug, Default)]
pub(crate) struct Subscribers {
    to: Vec<Sender<Arc<Published>>>,
    /// The latest version that was published.
    latest: Arc<AtomicU64>,
}

impl Subscribers {
    pub fn subscribe(&mut self, start: Arc<Snapshot>) -> Subscription {
        let (to, changes) = channel();
        self.to.push(to);
        self.latest.fetch_max(start.version, Ordering::AcqRel);
        Subscription { start, changes, latest: self.latest.clone() }
    }

    pub fn is_empty(&self) -> bool {
        self.to.is_empty()
    }

    /// Sends to all subscribers, and drops those that have closed. `next` is the snapshot after the changes.
    pub fn publish(&mut self, changes: Vec<Change>, next: &Snapshot) {
        let removed_by = |id: KeyFrameId| {
            let (parent, parent_from_it) = *next.removed.get(id.index())?;
            Some(Removed { key_frame: id, parent, parent_from_it })
        };
        let removed = changes.iter().filter_map(|change| match change {
            Change::RemoveKeyFrame(id) => removed_by(*id),
            _ => None,
        });
        let removed = removed.collect();
        let published = Arc::new(Published { version: next.version, changes, removed });
        self.latest.store(next.version, Ordering::Release);
        self.to.retain(|to| to.send(published.clone()).is_ok());
    }
}
