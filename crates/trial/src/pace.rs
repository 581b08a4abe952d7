//! When the page of a phone sends an image, of which size and quality: its `pace.js`, for programs that stand for it. The test of
//! the page in a browser asks both the same.

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

/// Decides about images by when the server has received those before.
pub struct Pace {
    /// Index into [`LEVELS`].
    pub level: usize,
    /// The shortest of the last round trips as the server tells it, milliseconds.
    pub trip_ms: f64,
    rate: Option<f64>,
    roomy: usize,
    last: Option<Instant>,
    /// When the link was free for the image after the last that the server received.
    free: Option<Instant>,
    unconfirmed: Vec<Unconfirmed>,
}

/// An image that the server has not said it received.
struct Unconfirmed {
    sent: Instant,
    stamp_ms: f64,
    bytes: usize,
}

impl Default for Pace {
    /// Starts at the middle level.
    fn default() -> Self {
        Self { level: 2, trip_ms: 0.0, rate: None, roomy: 0, last: None, free: None, unconfirmed: Vec::new() }
    }
}

impl Pace {
    /// Whether an image may be captured.
    pub fn may_shoot(&self, now: Instant) -> bool {
        self.last.is_none_or(|last| now - last >= SHORTEST) && self.has_arrived(now)
    }

    /// Whether the image sent last is at the server by now.
    fn has_arrived(&self, now: Instant) -> bool {
        match (&self.unconfirmed[..], self.rate) {
            ([], _) => true,
            ([one], Some(rate)) => {
                let took_ms =
                    1e3 * (now - self.free.map_or(one.sent, |free| free.max(one.sent))).as_secs_f64();
                took_ms >= one.bytes as f64 / rate + self.trip_ms / 2.0
            }
            _ => false,
        }
    }

    /// An image of so many bytes, with this time stamp, has been sent.
    pub fn sent(&mut self, now: Instant, stamp_ms: f64, bytes: usize) {
        self.last = Some(now);
        self.unconfirmed.push(Unconfirmed { sent: now, stamp_ms, bytes });
    }

    /// The server has received the image with this time stamp.
    pub fn got(&mut self, now: Instant, stamp_ms: f64) {
        // Numbers that went through text and back may differ in their last bit.
        let known = self.unconfirmed.iter().take_while(|one| one.stamp_ms <= stamp_ms + 1e-3).count();
        let Some(Unconfirmed { sent, bytes, .. }) = self.unconfirmed.drain(..known).next_back() else {
            return;
        };
        let left = now - Duration::from_secs_f64(1e-3 * self.trip_ms);
        let began = self.free.map_or(sent, |free| free.max(sent));
        self.free = Some(left);
        let rate = bytes as f64 / (1e3 * left.saturating_duration_since(began).as_secs_f64()).max(1.0);
        let rate = self.rate.map_or(rate, |before| 0.7 * before + 0.3 * rate);
        self.rate = Some(rate);
        self.adapt(bytes as f64, rate * (120.0 - 0.4 * self.trip_ms).clamp(20.0, 80.0));
    }

    /// The connection is new: images in flight are lost.
    pub fn reset(&mut self) {
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
