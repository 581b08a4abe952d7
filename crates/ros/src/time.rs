//! What time it is: that of this machine, or with `--use-sim-time` that of /clock.

use cairn::Stamp;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Before the first message of /clock.
const NOT_YET: i64 = i64::MIN;

/// The present time; clones refer to the same.
#[derive(Clone)]
pub struct Time(Option<Arc<AtomicI64>>);

impl Time {
    /// That of this machine.
    pub fn wall() -> Self {
        Self(None)
    }

    /// That of /clock.
    pub fn simulated() -> Self {
        Self(Some(Arc::new(AtomicI64::new(NOT_YET))))
    }

    /// Whether it is that of /clock.
    pub fn is_simulated(&self) -> bool {
        self.0.is_some()
    }

    /// Takes a message of /clock.
    pub fn set(&self, now: Stamp) {
        if let Some(time) = &self.0 {
            time.store(now.0, Ordering::Relaxed);
        }
    }

    /// The time; `None` before the first message of /clock.
    pub fn now(&self) -> Option<Stamp> {
        match &self.0 {
            Some(time) => Some(time.load(Ordering::Relaxed)).filter(|ns| *ns != NOT_YET).map(Stamp),
            None => {
                let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
                Some(Stamp(i64::try_from(now.as_nanos()).unwrap_or(i64::MAX)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simulated_time_is_what_was_said_last() {
        let time = Time::simulated();
        let same = time.clone();
        assert_eq!(time.now(), None);
        for ns in [5, 0, 7_000_000_000] {
            same.set(Stamp(ns));
            assert_eq!(time.now(), Some(Stamp(ns)));
        }
        let wall = Time::wall();
        wall.set(Stamp(5));
        assert!(wall.now().is_some_and(|now| now > Stamp(1_700_000_000_000_000_000)));
    }
}
