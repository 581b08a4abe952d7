//! What a live source tells while it is read on another thread: the time in its clock, and its present trouble.

use crate::Stamp;

/// The time in a source's clock, read from this machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockReading {
    /// The time now in the clock of the packets' stamps; the middle of what is possible.
    pub now: Stamp,
    /// The largest error of [`Self::now`], seconds: half the round trip over which the clocks were compared, where they are
    /// two machines'.
    pub bound_s: f64,
    /// Seconds that words take from here to the walker's ears, where they travel: half a recent round trip.
    pub delivery_s: f64,
}

impl ClockReading {
    /// How old what was captured at `stamp` can be at most, seconds: its age and the bound of the clock's error.
    pub fn oldest_s(&self, stamp: Stamp) -> f64 {
        self.now - stamp + self.bound_s
    }

    /// The same when words about it reach the walker, seconds. Error and way are not added: the clock of a page is the later
    /// by as much of the bound as the way to it is shorter (a question that left at `t0` and was answered at the page's time
    /// `p` makes it `p + now - t0` there when words that leave now arrive, whichever part of the round trip was the way there).
    pub fn oldest_when_heard_s(&self, stamp: Stamp) -> f64 {
        self.now - stamp + self.bound_s.max(self.delivery_s)
    }
}

/// A live source, seen from another thread than the one that reads it.
pub trait Live: Send + Sync {
    /// The time now in the clock of its stamps; `None` while that is not known, so that the age of a picture is not known
    /// either.
    fn clock(&self) -> Option<ClockReading>;

    /// What keeps its pictures from being used at present, in a sentence that stays the same while the reason does; `None`
    /// where nothing does.
    fn trouble(&self) -> Option<String> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn oldest_age_counts_the_error_and_the_way_to_the_ears() {
        let reading = ClockReading { now: Stamp::from_seconds(10.0), bound_s: 0.05, delivery_s: 0.1 };
        let captured = Stamp::from_seconds(9.8);
        assert!((reading.oldest_s(captured) - 0.25).abs() < 1e-9);
        assert!((reading.oldest_when_heard_s(captured) - 0.3).abs() < 1e-9);
    }
}
