//! The clock of a page, compared with this machine's by round trips.
//!
//! A question leaves at `t0` and its answer, with the page's time `p`, comes at `t1`, both by this machine's monotonic clock:
//! somewhere in between the page's clock showed `p`, so the offset (page minus machine) lies within `[p - t1, p - t0]`,
//! whatever part of the round trip was the way there. Cristian (1989, Probabilistic clock synchronization, eq. 1 to 3) takes
//! the sample of the shortest round trip; here the intervals of all recent samples are intersected (Marzullo and Owicki 1983,
//! Maintaining the time in a distributed system), which is at least as narrow, each widened by what the two clocks can drift
//! apart until now. Where nothing is left the page's clock was set or the phone slept, and only the newest sample counts.

use std::collections::VecDeque;
use std::time::{Duration, Instant};

/// Two quartz clocks run apart by at most this, seconds a second: 100 parts per million each.
const MAX_DRIFT: f64 = 2e-4;
/// Samples are used for this long.
const KEPT: Duration = Duration::from_secs(60);
/// A reading is valid for this long after the last answer.
const VALID: Duration = Duration::from_secs(10);
/// Samples kept at most: one and a half for each second, of each second the narrowest.
const MAX_SAMPLES: usize = 90;
/// Round trips over which the present delay is taken: the shortest of these.
const RECENT: usize = 4;

/// One round trip.
#[derive(Clone, Copy, Debug)]
struct Sample {
    received: Instant,
    /// Page minus machine, milliseconds since [`PageClock::origin`].
    low_ms: f64,
    high_ms: f64,
}

/// The comparison of a page's clock with this machine's.
#[derive(Debug)]
pub(super) struct PageClock {
    origin: Instant,
    samples: VecDeque<Sample>,
    round_trips_s: VecDeque<f64>,
    last: Option<Instant>,
}

/// The page's time at an instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PageTime {
    /// The middle of what is possible, the page's milliseconds.
    pub ms: f64,
    /// The largest error, seconds.
    pub bound_s: f64,
    /// Half the shortest of the last few round trips, seconds.
    pub delivery_s: f64,
}

impl PageClock {
    pub fn new() -> Self {
        Self { origin: Instant::now(), samples: VecDeque::new(), round_trips_s: VecDeque::new(), last: None }
    }

    /// Takes a round trip; false, and nothing taken, where the page's time is no time or the answer came before the question.
    pub fn round_trip(&mut self, sent: Instant, received: Instant, page_ms: f64) -> bool {
        let Some(trip) = received.checked_duration_since(sent) else { return false };
        // The largest time that ECMAScript knows.
        if !page_ms.is_finite() || page_ms.abs() > 8.64e15 {
            return false;
        }
        let sample = Sample {
            received,
            low_ms: page_ms - self.since_origin_ms(received),
            high_ms: page_ms - self.since_origin_ms(sent),
        };
        self.last = Some(received);
        if self.round_trips_s.len() == RECENT {
            self.round_trips_s.pop_front();
        }
        self.round_trips_s.push_back(trip.as_secs_f64());
        self.keep(sample);
        if self.offset_ms(received).is_none() {
            self.samples.clear();
            self.samples.push_back(sample);
        }
        true
    }

    /// Keeps a sample, of those within a second the narrowest.
    fn keep(&mut self, sample: Sample) {
        let width = |s: &Sample| s.high_ms - s.low_ms;
        match self.samples.back_mut() {
            Some(last) if sample.received - last.received < Duration::from_millis(700) => {
                // Another clock must not be hidden by a narrower sample of the old one.
                let apart = sample.low_ms > last.high_ms || last.low_ms > sample.high_ms;
                if apart || width(&sample) <= width(last) {
                    *last = sample;
                }
            }
            _ => self.samples.push_back(sample),
        }
        let since = sample.received;
        while self.samples.len() > MAX_SAMPLES
            || self.samples.front().is_some_and(|s| since - s.received > KEPT)
        {
            self.samples.pop_front();
        }
    }

    /// The page's time at an instant; `None` before the first answer, and when the last one is too long ago.
    pub fn at(&self, now: Instant) -> Option<PageTime> {
        let last = self.last?;
        if now.saturating_duration_since(last) > VALID {
            return None;
        }
        let (low, high) = self.offset_ms(now)?;
        let delivery_s = 0.5 * self.round_trips_s.iter().copied().fold(f64::INFINITY, f64::min);
        Some(PageTime {
            ms: 0.5 * (low + high) + self.since_origin_ms(now),
            bound_s: 0.5e-3 * (high - low),
            delivery_s: if delivery_s.is_finite() { delivery_s } else { 0.0 },
        })
    }

    /// The interval of the offset at an instant; `None` where the samples contradict each other.
    fn offset_ms(&self, now: Instant) -> Option<(f64, f64)> {
        if self.samples.is_empty() {
            return None;
        }
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for s in &self.samples {
            let drift_ms = 1e3 * MAX_DRIFT * now.saturating_duration_since(s.received).as_secs_f64();
            // Half a microsecond for rounding.
            low = low.max(s.low_ms - drift_ms - 5e-4);
            high = high.min(s.high_ms + drift_ms + 5e-4);
        }
        (low <= high).then_some((low, high))
    }

    fn since_origin_ms(&self, at: Instant) -> f64 {
        match at.checked_duration_since(self.origin) {
            Some(since) => since.as_secs_f64() * 1e3,
            None => -(self.origin - at).as_secs_f64() * 1e3,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic numbers within 0 and 1.
    fn numbers(seed: u64) -> impl FnMut() -> f64 {
        let mut random = cairn_random::Random::new(seed);
        move || random.unit()
    }

    fn after(start: Instant, s: f64) -> Instant {
        start + Duration::from_secs_f64(s)
    }

    /// The truth lies within the bound for every offset, drift and asymmetry, and the bound is half the shortest round trip.
    #[test]
    fn truth_lies_within_the_bound_under_jitter_asymmetry_and_drift() {
        for seed in 0..50 {
            let mut random = numbers(seed);
            let (offset, drift) = (1e12 * (random() - 0.5), 2e-4 * (2.0 * random() - 1.0));
            let page_ms = |s: f64| offset + 1e3 * s * (1.0 + drift);
            let mut clock = PageClock::new();
            let start = clock.origin;
            let (mut t, mut shortest) = (0.1, f64::INFINITY);
            for _ in 0..300 {
                let (there, back) = (0.01 + 0.4 * random().powi(3), 0.01 + 0.4 * random().powi(3));
                assert!(clock.round_trip(
                    after(start, t),
                    after(start, t + there + back),
                    page_ms(t + there)
                ));
                shortest = f64::min(shortest, there + back);
                t += there + back + 0.2 * random();
                let now = clock.at(after(start, t)).unwrap();
                // Doubles hold these times to 0.1 ms.
                let error_s = 1e-3 * (now.ms - page_ms(t)).abs();
                assert!(error_s <= now.bound_s + 3e-4, "seed {seed}: error {error_s}, bound {}", now.bound_s);
                assert!(now.bound_s <= 0.5 * shortest + 0.0125, "seed {seed}: bound {}", now.bound_s);
            }
        }
    }

    #[test]
    fn jump_of_the_clock_is_taken_up_and_silence_makes_it_unknown() {
        let mut clock = PageClock::new();
        let start = clock.origin;
        assert!(clock.at(start).is_none());
        for k in 0..20 {
            let t = f64::from(k);
            clock.round_trip(after(start, t), after(start, t + 0.02), 5000.0 + 1e3 * (t + 0.01));
        }
        assert!((clock.at(after(start, 20.0)).unwrap().ms - 25_000.0).abs() < 20.0);
        // The phone slept: its clock stood still for an hour.
        clock.round_trip(after(start, 20.0), after(start, 20.2), 1000.0);
        let now = clock.at(after(start, 20.2)).unwrap();
        assert!((now.ms - 1100.0).abs() < 101.0 && now.bound_s < 0.101, "{now:?}");
        assert!(clock.at(after(start, 35.0)).is_none());
    }

    #[test]
    fn answers_without_a_time_are_not_taken() {
        let mut clock = PageClock::new();
        let start = clock.origin;
        for garbage in [f64::NAN, f64::INFINITY, 1e300] {
            assert!(!clock.round_trip(start, after(start, 0.1), garbage));
        }
        assert!(!clock.round_trip(after(start, 0.1), start, 5.0));
        assert!(clock.at(after(start, 0.1)).is_none());
    }
}
