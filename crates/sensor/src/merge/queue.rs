//! One stream on its way into the merge: strictly rising in time, with a single wrong stamp found out.

use crate::Stamp;
use std::collections::VecDeque;
use std::fmt;

/// A step ahead that is longer than this, in seconds, is believed only when what follows bears it out.
const JUMP_S: f64 = 1.0;

/// Why something was dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// Earlier than one before it.
    Backwards,
    /// The same time as one before it.
    Repeated,
    /// So far ahead that those after it show it to be wrong.
    JumpsAhead,
    /// It holds a number that is not finite.
    NotFinite,
    /// There is no such stream.
    Unknown,
}

/// What was dropped: it, or one before it that it proved wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dropped {
    /// Its time, in the image clock.
    pub stamp: Stamp,
    /// Why.
    pub why: Why,
}

impl fmt::Display for Dropped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let why = match self.why {
            Why::Backwards => "the time goes backwards",
            Why::Repeated => "the time is repeated",
            Why::JumpsAhead => "the time jumps ahead",
            Why::NotFinite => "a number is not finite",
            Why::Unknown => "the rig has no such stream",
        };
        write!(f, "{}: {why}", self.stamp)
    }
}

/// A stream's items in order.
pub struct Lane<T> {
    /// Accepted and not yet taken.
    pub queue: VecDeque<(Stamp, T)>,
    /// No more will come.
    pub ended: bool,
    last: Option<Stamp>,
    /// Far ahead of the last, not believed yet.
    suspect: Option<(Stamp, T)>,
}

impl<T> Lane<T> {
    /// Empty; one that has ended from the start belongs to a sensor that is not there.
    pub fn new(ended: bool) -> Self {
        Self { queue: VecDeque::new(), ended, last: None, suspect: None }
    }

    /// The newest stamp that was believed.
    pub fn last(&self) -> Option<Stamp> {
        self.last
    }

    /// Takes an item; gives the longest step `(from, to)` in time that was accepted by it.
    pub fn push(&mut self, stamp: Stamp, item: T) -> Result<Option<(Stamp, Stamp)>, Dropped> {
        let fail = |stamp, why| Err(Dropped { stamp, why });
        match self.last {
            Some(last) if stamp < last => return fail(stamp, Why::Backwards),
            Some(last) if stamp == last => return fail(stamp, Why::Repeated),
            _ => {}
        }
        let mut step = None;
        if let Some((ahead, held)) = self.suspect.take() {
            if stamp < ahead {
                self.accept(stamp, item);
                return fail(ahead, Why::JumpsAhead);
            }
            if stamp == ahead {
                self.suspect = Some((ahead, held));
                return fail(stamp, Why::Repeated);
            }
            step = self.accept(ahead, held);
        }
        if self.last.is_some_and(|last| stamp - last > JUMP_S) {
            self.suspect = Some((stamp, item));
            return Ok(step);
        }
        let next = self.accept(stamp, item);
        Ok(step.or(next))
    }

    /// The stream has ended: what was held back is believed.
    pub fn end(&mut self) {
        self.ended = true;
        self.believe();
    }

    /// The clock says `now`: what lies before it is no jump.
    pub fn confirm(&mut self, now: Stamp) {
        if self.suspect.as_ref().is_some_and(|(stamp, _)| *stamp <= now) {
            self.believe();
        }
    }

    fn believe(&mut self) {
        if let Some((stamp, item)) = self.suspect.take() {
            self.accept(stamp, item);
        }
    }

    fn accept(&mut self, stamp: Stamp, item: T) -> Option<(Stamp, Stamp)> {
        let step = self.last.map(|last| (last, stamp));
        self.last = Some(stamp);
        self.queue.push_back((stamp, item));
        step
    }
}
