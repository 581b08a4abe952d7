//! The time of day, for what was recorded when. Passed in: a session has no clock of its own.

use std::sync::Arc;
use std::time::SystemTime;

const DAY_S: i64 = 86_400;

/// A moment in local time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WallTime {
    /// Seconds since 1970-01-01 00:00 UTC.
    pub unix_s: i64,
    /// Seconds that local time is ahead of UTC.
    pub offset_s: i32,
}

/// Tells the time of day.
pub type WallClock = Arc<dyn Fn() -> WallTime + Send + Sync>;

impl WallTime {
    /// The system's time, in UTC.
    pub fn now() -> Self {
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
        Self { unix_s: since.map_or(0, |d| i64::try_from(d.as_secs()).unwrap_or(i64::MAX)), offset_s: 0 }
    }

    /// How many days of the local calendar lie between an earlier moment and this one; 0 for the same day and for the
    /// future.
    pub fn days_since(&self, unix_s: i64) -> i64 {
        let day = |s: i64| s.saturating_add(i64::from(self.offset_s)).div_euclid(DAY_S);
        (day(self.unix_s) - day(unix_s)).max(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn days_are_those_of_the_local_calendar() {
        // 1970-01-02 01:00 UTC, and the evening before.
        let (now, evening) = (25 * 3600, 22 * 3600);
        assert_eq!(WallTime { unix_s: now, offset_s: 0 }.days_since(evening), 1);
        // Five hours west of Greenwich it is still the same evening.
        assert_eq!(WallTime { unix_s: now, offset_s: -5 * 3600 }.days_since(evening), 0);
        assert_eq!(WallTime { unix_s: now, offset_s: 0 }.days_since(now + 100_000), 0);
        assert!(WallTime { unix_s: i64::MAX, offset_s: 3600 }.days_since(0) > 1000);
    }
}
