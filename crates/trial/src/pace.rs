//! When the page of a phone sends an image, of which size and quality, and on which of its connections: its `pace.js`, for programs
//! that stand for it. The test of the page in a browser asks both the same.

use std::time::{Duration, Instant};

/// Longer side in pixels, quality in percent, approximate number of bytes as a share of the first level's.
pub const LEVELS: [(u32, u8, f64); 9] = [
    (640, 80, 1.0),
    (640, 65, 0.72),
    (640, 50, 0.56),
    (480, 60, 0.38),
    (480, 45, 0.3),
    (320, 60, 0.2),
    (320, 45, 0.16),
    (320, 30, 0.12),
    (320, 20, 0.09),
];
const SHORTEST: Duration = Duration::from_millis(45);
const PATIENCE: usize = 10;
/// An image that the server confirms later than this after it was expected to was lost on the way: milliseconds, and a share of the
/// round trip.
const OVERDUE: (f64, f64) = (40.0, 0.25);

/// From this rate on, bytes a millisecond, a link has room for several connections, and no longer below this: copies of what must
/// not wait take 50 kbit/s, and an image is most of what a slow link carries in its time.
const ROOM_RATES: [f64; 2] = [32.0, 26.0];
/// By how much the shortest round trip may grow from one image to the next. Round trips are long, too, while the page's own images
/// wait, and a rate computed with them is far too large.
const LONGER: f64 = 1.02;

/// Decides about images by when the server has received those before.
pub struct Pace {
    /// Index into [`LEVELS`].
    pub level: usize,
    /// The shortest of the last round trips as the server tells it, milliseconds.
    pub trip_ms: f64,
    connections: usize,
    rate: Option<f64>,
    /// The rate of the last image alone.
    sample: Option<f64>,
    /// The rate that there is at least, that of the last image alone, and the shortest round trip, by which they are computed.
    least: Option<f64>,
    least_sample: Option<f64>,
    shortest_ms: f64,
    heard: Option<Instant>,
    roomy: usize,
    last: Option<Instant>,
    last_on: usize,
    /// When the link was free for the image after the last that the server received.
    free: Option<Instant>,
    /// Time stamp of the newest that it received.
    newest_ms: Option<f64>,
    unconfirmed: Vec<Unconfirmed>,
}

/// An image that the server has not said it received.
struct Unconfirmed {
    sent: Instant,
    stamp_ms: f64,
    bytes: usize,
    on: usize,
}

impl Default for Pace {
    /// Starts at the middle level, with one connection.
    fn default() -> Self {
        Self {
            level: 2,
            trip_ms: 0.0,
            connections: 1,
            rate: None,
            sample: None,
            least: None,
            least_sample: None,
            shortest_ms: f64::INFINITY,
            heard: None,
            roomy: 0,
            last: None,
            last_on: 0,
            free: None,
            newest_ms: None,
            unconfirmed: Vec::new(),
        }
    }
}

impl Pace {
    /// Whether the link is fast enough for several connections; one that has them keeps them a little longer.
    pub fn has_room(&self) -> bool {
        self.least.is_some_and(|rate| rate >= ROOM_RATES[usize::from(self.connections > 1)])
    }

    /// Whether an image may be captured.
    pub fn may_shoot(&self, now: Instant) -> bool {
        self.last.is_none_or(|last| now - last >= SHORTEST) && self.connection(now).is_some()
    }

    /// The connection on which an image may leave; none while the link is not free for it, and while all connections wait for one
    /// that was lost.
    fn connection(&self, now: Instant) -> Option<usize> {
        let Some(rate) = self.rate else { return self.unconfirmed.is_empty().then_some(0) };
        // Times in milliseconds from now.
        let since = |then: Instant| -1e3 * now.saturating_duration_since(then).as_secs_f64();
        let mut free = self.free.map_or(f64::NEG_INFINITY, since);
        let mut waits = vec![false; self.connections];
        for one in &self.unconfirmed {
            free = free.max(since(one.sent)) + one.bytes as f64 / rate;
            waits[one.on] |= -free > self.trip_ms * (1.0 + OVERDUE.1) + OVERDUE.0;
        }
        let count = self.unconfirmed.len();
        if self.connections == 1 {
            // What has left the link has arrived half a round trip later.
            return (count == 0 || count == 1 && -free >= self.trip_ms / 2.0).then_some(0);
        }
        if count > 0 && free > 0.0 {
            return None;
        }
        (1..=self.connections).map(|k| (self.last_on + k) % self.connections).find(|on| !waits[*on])
    }

    /// An image of so many bytes, with this time stamp, is sent: the connection on which it has to leave.
    pub fn sent(&mut self, now: Instant, stamp_ms: f64, bytes: usize) -> usize {
        let on = self.connection(now).unwrap_or((self.last_on + 1) % self.connections);
        (self.last, self.last_on) = (Some(now), on);
        self.unconfirmed.push(Unconfirmed { sent: now, stamp_ms, bytes, on });
        on
    }

    /// The server has received the image with this time stamp. One before it on the same connection that it has not named was overtaken.
    pub fn got(&mut self, now: Instant, stamp_ms: f64) {
        // Numbers that went through text and back may differ in their last bit.
        let is_it = |one: &Unconfirmed| (one.stamp_ms - stamp_ms).abs() <= 1e-3;
        let Some(at) = self.unconfirmed.iter().position(is_it) else { return };
        let Unconfirmed { sent, bytes, on, .. } = self.unconfirmed.remove(at);
        let mut k = 0;
        self.unconfirmed.retain(|one| {
            k += 1;
            k > at || one.on != on
        });
        let left = now - Duration::from_secs_f64(1e-3 * self.trip_ms);
        // One that comes after a later one was lost on the way, and tells nothing of the link.
        if self.newest_ms.is_some_and(|newest| newest > stamp_ms) {
            return;
        }
        self.newest_ms = Some(stamp_ms);
        self.look_for_room(now, sent, bytes as f64);
        let began = self.free.map_or(sent, |free| free.max(sent));
        self.free = Some(left);
        let rate = bytes as f64 / (1e3 * left.saturating_duration_since(began).as_secs_f64()).max(1.0);
        // Two that took much longer than the average: the link has become slow. One was held up.
        let best = self.sample.replace(rate).map_or(rate, |before| before.max(rate));
        let average = |before: f64| if best < 0.5 * before { best } else { 0.7 * before + 0.3 * rate };
        let rate = self.rate.map_or(rate, average);
        self.rate = Some(rate);
        self.adapt(bytes as f64, rate * (120.0 - 0.4 * self.trip_ms).clamp(20.0, 80.0));
    }

    /// An image that was sent then has been received: the rate of the link, as it is at least.
    fn look_for_room(&mut self, now: Instant, sent: Instant, bytes: f64) {
        let since = |then: Instant| 1e3 * now.saturating_duration_since(then).as_secs_f64();
        let heard = self.heard.replace(now);
        if self.trip_ms > 0.0 {
            self.shortest_ms = (LONGER * self.shortest_ms).min(self.trip_ms);
            let took = heard.map_or(f64::INFINITY, since).min(since(sent) - self.shortest_ms);
            let sample = bytes / took.max(1.0);
            // What was held up comes together with what came after it.
            let least = self.least_sample.replace(sample).map_or(sample, |before| sample.min(before));
            self.least = Some(self.least.map_or(least, |before| 0.7 * before + 0.3 * least));
        }
    }

    /// There are so many connections now, and what was on its way is lost.
    pub fn reset(&mut self, connections: usize) {
        self.connections = connections;
        self.last_on = 0;
        self.newest_ms = None;
        self.unconfirmed.clear();
    }

    fn adapt(&mut self, bytes: f64, budget: f64) {
        let whole = bytes / LEVELS[self.level].2;
        if bytes > 1.1 * budget {
            self.roomy = 0;
            while self.level < LEVELS.len() - 1 && whole * LEVELS[self.level].2 > budget {
                self.level += 1;
            }
        } else if self.level > 0 && whole * LEVELS[self.level - 1].2 < 0.7 * budget {
            self.roomy += 1;
            if self.roomy >= PATIENCE {
                (self.roomy, self.level) = (0, self.level - 1);
            }
        } else {
            self.roomy = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Images of half the time that is between them go over a link of this rate, whose round trip is 50 ms; the server tells `told`
    /// milliseconds from the hundredth on.
    fn over(rate: f64, told: f64) -> Pace {
        let began = Instant::now();
        let at = |ms: f64| began + Duration::from_secs_f64(1e-3 * ms);
        let mut pace = Pace { trip_ms: 50.0, ..Pace::default() };
        for k in 0..120 {
            let (sent, took) = (500.0 * f64::from(k), 120.0);
            pace.sent(at(sent), sent, (rate * took) as usize);
            pace.trip_ms = if k < 100 { 50.0 } else { told };
            pace.got(at(sent + took + 50.0), sent);
        }
        pace
    }

    #[test]
    fn slow_link_has_no_room_whatever_its_round_trips_are_while_images_wait() {
        for (rate, room) in [(25.0, false), (60.0, true), (500.0, true)] {
            assert_eq!(over(rate, 50.0).has_room(), room, "{rate} bytes a millisecond");
        }
        let queued = over(25.0, 165.0);
        assert!(queued.rate.unwrap() > 300.0, "round trips with the page's own images in them mislead");
        assert!(!queued.has_room(), "{:?}", queued.least);
    }

    #[test]
    fn room_that_there_is_is_not_taken_away_by_a_little_less() {
        let began = Instant::now();
        let mut pace = Pace { trip_ms: 50.0, least: Some(29.0), ..Pace::default() };
        assert!(!pace.has_room());
        pace.reset(3);
        assert!(pace.has_room() && pace.connection(began).is_some());
        pace.least = Some(25.0);
        assert!(!pace.has_room());
    }
}
