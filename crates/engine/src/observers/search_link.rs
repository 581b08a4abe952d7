//! The engine's end of the link to a search by depth for its lost camera ([`crate::DenseMapper`]).

use super::observer::{Observer, TrackedFrame};
use crate::depth_link::Link;
use cairn_tracking::{FoundByDepth, State};

/// The link, if a dense mapper looks for the camera.
#[derive(Debug, Default)]
pub(crate) struct SearchLink {
    link: Option<Link>,
    /// Whether tracking was told a place for the frame in hand.
    was_told: bool,
}

impl SearchLink {
    /// The link, made where there is none.
    pub fn link(&mut self) -> Link {
        self.link.get_or_insert_default().clone()
    }

    /// Where a search has found the camera, for the next frame.
    pub fn found(&mut self) -> Option<FoundByDepth> {
        let found = self.link.as_ref().and_then(|link| link.lock().found.take());
        self.was_told = found.is_some();
        found
    }
}

impl Observer for SearchLink {
    /// Tells the search what came of the place it found, and what it has to know of gravity.
    fn tracked(&mut self, frame: &TrackedFrame) {
        let Some(link) = &self.link else { return };
        let is_lost = matches!(frame.tracked.state, State::Lost { .. });
        if !self.was_told && !is_lost {
            return;
        }
        let (tracker, snapshot) = (frame.tracker, frame.snapshot);
        let mut shared = link.lock();
        shared.taken[usize::from(is_lost)] += usize::from(self.was_told);
        shared.up = tracker.up(frame.tracked.stamp);
        shared.is_of_use = tracker.may_believe_depth(frame.frame);
        let gravity_aligned =
            snapshot.maps().map(|(map, _)| map).filter(|map| snapshot.is_gravity_aligned(*map));
        shared.gravity_aligned = gravity_aligned.collect();
    }
}
