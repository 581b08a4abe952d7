//! The queue of one sensor stream: strictly increasing stamps, with detection of single wrong stamps.

use crate::Stamp;
use std::collections::VecDeque;
use std::fmt;

/// A forward jump of more than this, in seconds, is accepted only when the following stamps confirm it.
const JUMP_S: f64 = 1.0;

/// Why an item was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DropReason {
    /// Its time is earlier than that of a previous item.
    Backwards,
    /// Its time is the same as that of a previous item.
    Repeated,
    /// Its time was far ahead and the following items showed it to be wrong.
    JumpsAhead,
    /// It contains a number that is not finite.
    NotFinite,
    /// The stream does not exist.
    Unknown,
}

/// A dropped item: the pushed one, or a previous one that it proved wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// Time of the dropped item, in the image clock.
    pub stamp: Stamp,
    /// Reason.
    pub why: DropReason,
}

impl fmt::Display for DropReason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Backwards => "the time goes backwards",
            Self::Repeated => "the time is repeated",
            Self::JumpsAhead => "the time jumps ahead",
            Self::NotFinite => "a number is not finite",
            Self::Unknown => "the rig has no such stream",
        })
    }
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.stamp, self.why)
    }
}

/// Queue of one stream, in order of time.
pub struct StreamQueue<T> {
    /// Items accepted and not yet taken.
    pub items: VecDeque<(Stamp, T)>,
    /// True when no more items will come.
    pub ended: bool,
    /// The newest accepted stamp.
    last: Option<Stamp>,
    /// An item far ahead of the last one, not confirmed yet.
    suspect: Option<(Stamp, T)>,
}

impl<T> StreamQueue<T> {
    /// An empty queue; `ended` from the start for a sensor that does not exist.
    pub fn new(ended: bool) -> Self {
        Self { items: VecDeque::new(), ended, last: None, suspect: None }
    }

    /// The newest accepted stamp.
    pub fn last(&self) -> Option<Stamp> {
        self.last
    }

    /// Adds an item; returns the longest time step `(from, to)` accepted with it.
    ///
    /// # Errors
    /// The item that was dropped: this one, or a previous one that it proves wrong.
    pub fn push(&mut self, stamp: Stamp, item: T) -> Result<Option<(Stamp, Stamp)>, Dropped> {
        let fail = |stamp, why| Err(Dropped { stamp, why });
        match self.last {
            Some(last) if stamp < last => return fail(stamp, DropReason::Backwards),
            Some(last) if stamp == last => return fail(stamp, DropReason::Repeated),
            _ => {}
        }
        let mut step = None;
        if let Some((ahead, suspect)) = self.suspect.take() {
            if stamp < ahead {
                self.accept(stamp, item);
                return fail(ahead, DropReason::JumpsAhead);
            }
            if stamp == ahead {
                self.suspect = Some((ahead, suspect));
                return fail(stamp, DropReason::Repeated);
            }
            step = self.accept(ahead, suspect);
        }
        if self.last.is_some_and(|last| stamp - last > JUMP_S) {
            self.suspect = Some((stamp, item));
            return Ok(step);
        }
        let next = self.accept(stamp, item);
        Ok(step.or(next))
    }

    /// Marks the end of the stream: an unconfirmed item is accepted.
    pub fn end(&mut self) {
        self.ended = true;
        self.accept_suspect();
    }

    /// Confirms an unconfirmed item up to the time `now`.
    pub fn confirm(&mut self, now: Stamp) {
        if self.suspect.as_ref().is_some_and(|(stamp, _)| *stamp <= now) {
            self.accept_suspect();
        }
    }

    fn accept_suspect(&mut self) {
        if let Some((stamp, item)) = self.suspect.take() {
            self.accept(stamp, item);
        }
    }

    fn accept(&mut self, stamp: Stamp, item: T) -> Option<(Stamp, Stamp)> {
        let step = self.last.map(|last| (last, stamp));
        self.last = Some(stamp);
        self.items.push_back((stamp, item));
        step
    }
}
