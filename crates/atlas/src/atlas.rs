//! The atlas: one writer, many readers, and subscribers to every change.

use crate::paging::Paging;
use crate::rebase::rebase;
use crate::stream::Subscribers;
use crate::{Applied, Change, MapId, Snapshot, Subscription};
use arc_swap::ArcSwap;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The single writer: holds the latest snapshot and publishes each version.
#[derive(Debug)]
pub struct Atlas {
    latest: Arc<Snapshot>,
    published: Arc<ArcSwap<Snapshot>>,
    subscribers: Subscribers,
    paging: Paging,
    /// Every version since they were last taken, where they are recorded.
    recorded: Option<Vec<Arc<Snapshot>>>,
}

/// Reads the latest snapshot without a lock.
#[derive(Clone, Debug)]
pub struct Reader(Arc<ArcSwap<Snapshot>>);

impl Reader {
    /// The latest snapshot; it never changes while it is held.
    pub fn latest(&self) -> Arc<Snapshot> {
        self.0.load_full()
    }
}

impl Atlas {
    /// An atlas that starts with this snapshot.
    pub fn new(snapshot: Snapshot) -> Self {
        let latest = Arc::new(snapshot);
        let published = Arc::new(ArcSwap::new(latest.clone()));
        Self {
            latest,
            published,
            subscribers: Subscribers::default(),
            paging: Paging::default(),
            recorded: None,
        }
    }

    /// A reader for another stage.
    pub fn reader(&self) -> Reader {
        Reader(self.published.clone())
    }

    /// The stream of changes from the latest snapshot on. It costs nothing without subscribers; a dropped
    /// receiver is forgotten.
    pub fn subscribe(&mut self) -> Subscription {
        self.subscribers.subscribe(self.latest.clone())
    }

    /// Records every version from the latest on until [`Atlas::kept_versions`] takes them.
    pub fn keep_versions(&mut self) {
        self.recorded = Some(vec![self.latest.clone()]);
    }

    /// Takes the versions recorded since the last call, in order; none where they are not recorded.
    pub fn kept_versions(&mut self) -> Vec<Arc<Snapshot>> {
        self.recorded.as_mut().map(std::mem::take).unwrap_or_default()
    }

    /// The latest snapshot.
    pub fn latest(&self) -> &Arc<Snapshot> {
        &self.latest
    }

    /// Applies changes and publishes the next version. An empty list changes nothing.
    pub fn commit(&mut self, changes: Vec<Change>) -> Applied {
        if changes.is_empty() {
            return Applied::default();
        }
        let mut dropped = Vec::new();
        let (mut next, applied) = self.latest.apply_noting(&changes, |nth| dropped.push(nth));
        self.paging.sweep(&mut next);
        self.latest = Arc::new(next);
        self.published.store(self.latest.clone());
        if let Some(recorded) = &mut self.recorded {
            recorded.push(self.latest.clone());
        }
        if !self.subscribers.is_empty() {
            let mut dropped = dropped.into_iter().peekable();
            let done = changes.into_iter().enumerate();
            let done = done.filter(|(nth, _)| dropped.next_if_eq(nth).is_none()).map(|(_, change)| change);
            self.subscribers.publish(done.collect(), &self.latest);
        }
        applied
    }

    /// Applies changes that were made on an older snapshot: what has been moved or created since moves along.
    /// Where a map has been gravity-aligned or rescaled since, all of them are dropped: their coordinates are in a frame
    /// that no longer exists.
    pub fn commit_since(&mut self, base: &Snapshot, changes: Vec<Change>) -> Applied {
        if base.version() == self.latest.version() {
            return self.commit(changes);
        }
        let times = |counts: &BTreeMap<MapId, u32>, map| counts.get(&map).copied();
        let frame = |s: &Snapshot, map| (times(&s.gravity_alignments, map), times(&s.rescalings, map));
        let frames = |s: &Snapshot| s.maps().map(|(map, _)| (map, frame(s, map))).collect();
        let (before, now): (BTreeMap<_, _>, BTreeMap<_, _>) = (frames(base), frames(&self.latest));
        if before.iter().any(|(map, times)| now.get(map).is_some_and(|t| t != times)) {
            return Applied { done: 0, dropped: changes.len() };
        }
        let rebased = rebase(base, changes, &self.latest);
        self.commit(rebased)
    }
}
