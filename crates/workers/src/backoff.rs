//! How long to wait before a process that died is started again.

use std::time::Duration;

/// Deaths in a row without any work done in between.
#[derive(Clone, Debug, Default)]
pub struct Backoff {
    times: usize,
}

/// Waits after the first, second, ... such death; after the last it is given up.
const WAITS_MS: [u64; 6] = [0, 250, 500, 1000, 2000, 4000];

impl Backoff {
    /// How long to wait after a death; none at all after one that had done some work. `None`: give it up.
    pub fn after_death(&mut self, had_done_work: bool) -> Option<Duration> {
        if had_done_work {
            self.times = 0;
            return Some(Duration::ZERO);
        }
        self.times += 1;
        WAITS_MS.get(self.times - 1).map(|ms| Duration::from_millis(*ms))
    }

    /// The process does its work.
    pub fn calm(&mut self) {
        self.times = 0;
    }

    /// Deaths in a row.
    pub fn times(&self) -> usize {
        self.times
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_until_it_is_given_up_and_work_resets_them() {
        let mut backoff = Backoff::default();
        assert_eq!(backoff.after_death(true), Some(Duration::ZERO));
        let waits: Vec<_> = (0..7).map(|_| backoff.after_death(false).map(|d| d.as_millis())).collect();
        assert_eq!(waits[..3], [Some(0), Some(250), Some(500)]);
        assert_eq!((waits[5], waits[6]), (Some(4000), None));
        backoff.calm();
        assert_eq!((backoff.after_death(false), backoff.times()), (Some(Duration::ZERO), 1));
    }
}
