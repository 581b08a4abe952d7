//! What the page of a phone decides by its own clock: whether poses come too late for directions. For programs that stand for
//! it, as [`crate::Pace`].

use std::time::Instant;

/// Directions from older poses are not given, milliseconds.
pub const STALE_MS: f64 = 500.0;
/// They are given again only after the poses were fresh for this long, milliseconds.
const FRESH_MS: u128 = 1000;

/// A phone's clock, which differs from this machine's.
#[derive(Clone, Copy, Debug)]
pub struct PageClock {
    began: Instant,
    offset_ms: f64,
    drift: f64,
}

impl PageClock {
    /// Shows `offset_ms` now, and gains `drift` seconds a second.
    pub fn new(offset_ms: f64, drift: f64) -> Self {
        Self { began: Instant::now(), offset_ms, drift }
    }

    /// Seconds since its beginning, by this machine's clock.
    pub fn seconds(&self) -> f64 {
        self.began.elapsed().as_secs_f64()
    }

    /// What it shows at these seconds since its beginning, milliseconds.
    pub fn ms_at(&self, seconds: f64) -> f64 {
        self.offset_ms + 1e3 * seconds * (1.0 + self.drift)
    }

    /// Seconds since its beginning at which it shows this.
    pub fn seconds_of(&self, ms: f64) -> f64 {
        (ms - self.offset_ms) * 1e-3 / (1.0 + self.drift)
    }

    /// What it shows now, milliseconds.
    pub fn ms(&self) -> f64 {
        self.ms_at(self.seconds())
    }
}

/// Whether poses come too late for directions.
#[derive(Clone, Copy, Debug, Default)]
pub struct Lateness {
    is_late: bool,
    fresh_since: Option<Instant>,
}

impl Lateness {
    /// Whether they do.
    pub fn is_late(&self) -> bool {
        self.is_late
    }

    /// A pose was older than [`STALE_MS`]. True where they were not late before: the server has to be told.
    pub fn begin(&mut self) -> bool {
        self.fresh_since = None;
        !std::mem::replace(&mut self.is_late, true)
    }

    /// Takes the age of the newest pose. True where they have been fresh for long enough: it is over, and the server has to be
    /// told.
    pub fn ends(&mut self, age_ms: Option<f64>, now: Instant) -> bool {
        if !(self.is_late && age_ms.is_some_and(|age| age < STALE_MS)) {
            self.fresh_since = None;
            return false;
        }
        let since = *self.fresh_since.get_or_insert(now);
        let ends = now.duration_since(since).as_millis() >= FRESH_MS;
        if ends {
            *self = Self::default();
        }
        ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    #[test]
    fn clock_runs_at_its_own_rate_and_back() {
        let clock = PageClock::new(5e5, 1e-3);
        assert!((clock.ms_at(10.0) - 510_010.0).abs() < 1e-6);
        assert!((clock.seconds_of(clock.ms_at(7.5)) - 7.5).abs() < 1e-9);
        assert!(clock.ms() >= 5e5 && clock.seconds() < 60.0);
    }

    #[test]
    fn lateness_ends_after_a_second_of_fresh_poses_in_a_row() {
        let began = Instant::now();
        let at = |ms: u64| began + Duration::from_millis(ms);
        let mut lateness = Lateness::default();
        assert!(!lateness.ends(Some(100.0), at(0)), "nothing was late");
        assert!(lateness.begin() && !lateness.begin(), "the server is told once");
        assert!(!lateness.ends(Some(100.0), at(0)));
        assert!(!lateness.ends(Some(600.0), at(900)), "one was late again");
        assert!(!lateness.ends(Some(100.0), at(1000)));
        assert!(!lateness.ends(Some(100.0), at(1999)) && lateness.is_late());
        assert!(lateness.ends(Some(100.0), at(2000)) && !lateness.is_late());
        assert!(lateness.begin(), "the next time is told again");
        assert!(!lateness.ends(None, at(5000)), "no pose is not a fresh one");
    }
}
