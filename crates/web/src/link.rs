//! The connection to one page: pings that measure round trips, detection of a silent page, and a limit on the data
//! sent.
//!
//! A `ping` is answered by a `pong` with the page's time. At most one is in flight. Bulk data (status, map, images)
//! is sent only while none is, and is followed by one: so at most one piece of bulk data is in flight, and words
//! never queue behind more. The rate of the link is the largest of the last few deliveries (as in Cardwell and others
//! 2016, BBR), and bulk data that would take longer than [`BULK_S`] is not sent.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// A ping is sent at least this often.
pub(crate) const ASK_EVERY: Duration = Duration::from_millis(250);
/// A page that sends nothing for this long counts as gone, even if its connection has not closed.
pub(crate) const GONE_AFTER: Duration = Duration::from_secs(3);
/// Longest time of bulk data on the link, seconds: words that arrive meanwhile wait for it.
const BULK_S: f64 = 0.15;
/// Bytes that may be sent before anything is known about the link.
const UNKNOWN_BYTES: usize = 4096;
/// Number of round trips and of rates that are remembered: few enough trips that a network that has changed is known for what it
/// is after two or three seconds.
const TRIPS: usize = 8;
const RATES: usize = 20;

/// Data in flight to a page, and measurements of the link.
pub(crate) struct Link {
    heard: Instant,
    asked: Option<(u64, Instant, usize)>,
    number: u64,
    last_asked: Option<Instant>,
    trips: VecDeque<Duration>,
    /// Bytes per second.
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

    /// A message arrived from the page.
    pub fn heard(&mut self, now: Instant) {
        self.heard = now;
    }

    /// Whether the page counts as gone.
    pub fn is_gone(&self, now: Instant) -> bool {
        now.saturating_duration_since(self.heard) >= GONE_AFTER
    }

    /// Whether the interval until the next ping has passed.
    pub fn is_due(&self, now: Instant) -> bool {
        self.asked.is_none() && self.last_asked.is_none_or(|t| now.saturating_duration_since(t) >= ASK_EVERY)
    }

    /// The number of the ping that is sent now, after this many bytes of bulk data.
    pub fn ask(&mut self, now: Instant, bulk: usize) -> u64 {
        self.number += 1;
        (self.asked, self.last_asked) = (Some((self.number, now, bulk)), Some(now));
        self.number
    }

    /// Takes the answer to a ping; returns when that ping was sent, if the number is that of the one in flight.
    pub fn answered(&mut self, number: u64, now: Instant) -> Option<Instant> {
        let (_, sent, bulk) = self.asked.take_if(|(n, ..)| *n == number)?;
        let trip = now.saturating_duration_since(sent);
        remember(&mut self.trips, TRIPS, trip);
        if bulk > 0 {
            let least = self.trips.iter().min().copied().unwrap_or_default();
            remember(
                &mut self.rates,
                RATES,
                bulk as f64 / trip.saturating_sub(least).as_secs_f64().max(1e-3),
            );
        }
        Some(sent)
    }

    /// The shortest of the last round trips, milliseconds; `None` before the first.
    pub fn trip_ms(&self) -> Option<f64> {
        self.trips.iter().min().map(|t| 1e3 * t.as_secs_f64())
    }

    /// Whether bulk data of this size may be sent now.
    pub fn may_send(&self, bytes: usize) -> bool {
        self.asked.is_none() && bytes <= self.room()
    }

    /// The largest bulk data that may be sent while none is under way, bytes.
    pub fn room(&self) -> usize {
        let rate = self.rates.iter().copied().fold(0.0, f64::max);
        UNKNOWN_BYTES.max((BULK_S * rate) as usize)
    }
}

fn remember<T>(queue: &mut VecDeque<T>, most: usize, value: T) {
    if queue.len() == most {
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
        // On a fast link the map may be sent.
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
