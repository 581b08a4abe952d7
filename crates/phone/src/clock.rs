//! The page's clock as the session follows it: the time of the newest message, and whether words reach the walker late.

use cairn_sensor::{ClockReading, Live, Stamp};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

/// What the way of the words is taken to be longer while the page finds them late, seconds.
const LATE_S: f64 = 1.0;

/// The page's clock: as messages tell it, so that the same messages give the same walk.
#[derive(Debug, Default)]
pub(crate) struct PageClock {
    now_ns: AtomicI64,
    is_late: AtomicBool,
}

impl PageClock {
    /// It is at least this time now.
    pub fn reached(&self, now: Stamp) {
        self.now_ns.fetch_max(now.0, Ordering::Relaxed);
    }

    /// The page, which knows how old pictures are when it speaks, finds directions too late; or no longer.
    pub fn late(&self, is_late: bool) {
        self.is_late.store(is_late, Ordering::Relaxed);
    }
}

impl Live for PageClock {
    fn clock(&self) -> Option<ClockReading> {
        let delivery_s = if self.is_late.load(Ordering::Relaxed) { LATE_S } else { 0.0 };
        Some(ClockReading { now: Stamp(self.now_ns.load(Ordering::Relaxed)), bound_s: 0.0, delivery_s })
    }
}
