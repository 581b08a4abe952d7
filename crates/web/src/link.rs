//! The connection to one page: questions and answers that measure round trips, silence that ends it, and how much may be sent.
//!
//! A question (`ping`) is answered (`pong`) with the page's time. At most one is under way. Bulk (status, map, pictures) is
//! sent only while none is, and followed by one: so at most one piece of bulk is under way, and words never queue behind
//! more. The rate of the link is the largest of the last few deliveries (as in Cardwell and others 2016, BBR), and bulk that
//! would take longer than [`BULK_S`] is not sent.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// A page is asked at least this often.
pub(crate) const ASK_EVERY: Duration = Duration::from_millis(250);
/// A page that sends nothing for this long is gone, though its connection may not know it.
pub(crate) const GONE_AFTER: Duration = Duration::from_secs(3);
/// Bulk may take this long on the link, seconds: words that come meanwhile wait for it.
const BULK_S: f64 = 0.15;
/// Before anything is known of the link, this many bytes may be sent.
const UNKNOWN_BYTES: usize = 4096;
/// Round trips and rates that are remembered.
const REMEMBERED: usize = 20;

/// What is under way to a page, and what is known of the way.
pub(crate) struct Link {
    heard: Instant,
    asked: Option<(u64, Instant, usize)>,
    number: u64,
    last_asked: Option<Instant>,
    trips: VecDeque<Duration>,
    /// Bytes a second.
    rates: VecDeque<f64>,
}

impl Link {
    pub fn new(now: Instant) -> Self {
        Self {
            heard: now,
            asked: None,
            number: 0,
            last_asked: None,
            trips: VecDeque::new(),
            rates: VecDeque::new(),
        }
    }

    /// Something came from the page.
    pub fn heard(&mut self, now: Instant) {
        self.heard = now;
    }

    /// Whether the page is gone.
    pub fn is_gone(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.heard) >= GONE_AFTER
    }

    /// Whether a question is due by the time that has passed.
    pub fn is_due(&self, now: Instant) -> bool {
        self.asked.is_none() && self.last_asked.is_none_or(|t| now.saturating_duration_since(t) >= ASK_EVERY)
    }

    /// The number of the question that leaves now, behind this many bytes of bulk.
    pub fn ask(&mut self, now: Instant, bulk: usize) -> u64 {
        self.number += 1;
        (self.asked, self.last_asked) = (Some((self.number, now, bulk)), Some(now));
        self.number
    }

    /// The answer to a question; when that question left, if it is the one that was asked.
    pub fn answered(&mut self, number: u64, now: Instant) -> Option<Instant> {
        let (_, sent, bulk) = self.asked.take_if(|(n, ..)| *n == number)?;
        let trip = now.saturating_duration_since(sent);
        remember(&mut self.trips, trip);
        if bulk > 0 {
            let least = self.trips.iter().min().copied().unwrap_or_default();
            remember(&mut self.rates, bulk as f64 / trip.saturating_sub(least).as_secs_f64().max(1e-3));
        }
        Some(sent)
    }

    /// The shortest of the last round trips, milliseconds; `None` before the first.
    pub fn trip_ms(&self) -> Option<f64> {
        self.trips.iter().min().map(|t| 1e3 * t.as_secs_f64())
    }

    /// Whether bulk of this size may be sent now.
    pub fn may_send(&self, bytes: usize) -> bool {
        if self.asked.is_some() {
            return false;
        }
        match self.rates.iter().copied().reduce(f64::max) {
            Some(rate) => bytes <= UNKNOWN_BYTES || bytes as f64 <= BULK_S * rate,
            None => bytes <= UNKNOWN_BYTES,
        }
    }
}

fn remember<T>(queue: &mut VecDeque<T>, value: T) {
    if queue.len() == REMEMBERED {
        queue.pop_front();
    }
    queue.push_back(value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_piece_of_bulk_is_under_way_and_large_ones_only_on_a_fast_link() {
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let mut link = Link::new(start);
        assert!(link.is_due(start) && link.may_send(1000) && !link.may_send(150_000));
        let n = link.ask(start, 0);
        assert!(!link.may_send(1000) && !link.is_due(at(900)));
        assert_eq!(link.answered(n + 1, at(30)), None);
        assert_eq!(link.answered(n, at(40)), Some(start));
        // 1,200 bytes take 48 ms at 0.2 Mbit/s: the map would take six seconds.
        let n = link.ask(at(100), 1200);
        link.answered(n, at(188));
        assert!(link.may_send(3000) && !link.may_send(150_000));
        // On a fast link it may go.
        let n = link.ask(at(200), 1500);
        link.answered(n, at(240));
        assert!(link.may_send(150_000));
    }

    #[test]
    fn silence_of_three_seconds_is_the_end() {
        let start = Instant::now();
        let mut link = Link::new(start);
        assert!(!link.is_gone(start + Duration::from_millis(2900)));
        assert!(link.is_gone(start + GONE_AFTER));
        link.heard(start + GONE_AFTER);
        assert!(!link.is_gone(start + 2 * GONE_AFTER - Duration::from_millis(1)));
    }
}
