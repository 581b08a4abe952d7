//! Whether the walker is to be told that no way past an obstacle is found.
//!
//! In: at each step, how far along the route he is, whether something is in his way, and whether a way past it was searched
//! in vain. Out: when to give up: nothing was found for a while from where he stands, or he has been led around before the same
//! obstacle for minutes and got no farther.

use super::seconds_since;
use cairn_sensor::Stamp;

/// Nothing was found from where he stands for this long, seconds: a person or a door may be gone by then.
const NOTHING_S: f64 = 12.0;
/// Led around before one obstacle for this long, seconds.
const TRIED_S: f64 = 150.0;
/// Who has got so much farther along the route than ever before, metres, has passed it.
const FARTHER_M: f64 = 1.0;

/// What was tried before one obstacle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Attempts {
    last: Option<Stamp>,
    /// Metres along the route where the walker was when it began to count.
    from_m: Option<f64>,
    /// For how long something has been in the way since.
    blocked_s: f64,
    /// Since when nothing has been found from where he stands.
    nothing: Option<Stamp>,
}

impl Attempts {
    /// Takes a step of a walker so far along the route, metres.
    pub fn step(&mut self, along_m: f64, blocked: bool, now: Stamp) {
        let dt = seconds_since(&mut self.last, now);
        let from_m = *self.from_m.get_or_insert(along_m);
        if along_m > from_m + FARTHER_M {
            (self.from_m, self.blocked_s) = (Some(along_m), 0.0);
        }
        if blocked {
            self.blocked_s += dt;
        } else {
            self.nothing = None;
        }
    }

    /// A way past was searched.
    pub fn searched(&mut self, found: bool, now: Stamp) {
        if found {
            self.nothing = None;
        } else {
            self.nothing.get_or_insert(now);
        }
    }

    /// Whether he has been led around in vain: nothing more is tried until he has got farther or the way is free.
    pub fn are_exhausted(&self) -> bool {
        self.blocked_s >= TRIED_S
    }

    /// Whether he is to be told that no way past is found.
    pub fn have_failed(&self, now: Stamp) -> bool {
        self.are_exhausted() || self.nothing.is_some_and(|since| now - since >= NOTHING_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Steps at 10 Hz for some seconds.
    fn steps(tries: &mut Attempts, from_s: f64, seconds: f64, along_m: f64, blocked: bool) -> Stamp {
        let mut now = Stamp::from_seconds(from_s);
        for k in 1..=(10.0 * seconds) as i64 {
            now = Stamp::from_seconds(from_s + 0.1 * k as f64);
            tries.step(along_m, blocked, now);
        }
        now
    }

    #[test]
    fn nothing_found_for_a_while_is_told_until_something_is() {
        let mut tries = Attempts::default();
        let now = steps(&mut tries, 0.0, 1.0, 3.0, true);
        tries.searched(false, now);
        assert!(!tries.have_failed(now.plus_seconds(NOTHING_S - 1.0)));
        assert!(tries.have_failed(now.plus_seconds(NOTHING_S)) && !tries.are_exhausted());
        tries.searched(true, now.plus_seconds(NOTHING_S));
        assert!(!tries.have_failed(now.plus_seconds(NOTHING_S)));
        tries.searched(false, now);
        tries.step(3.0, false, now.plus_seconds(1.0));
        assert!(!tries.have_failed(now.plus_seconds(NOTHING_S + 1.0)), "the way was free");
    }

    #[test]
    fn minutes_before_one_obstacle_are_enough_and_getting_past_it_begins_anew() {
        let mut tries = Attempts::default();
        steps(&mut tries, 0.0, TRIED_S - 1.0, 3.0, true);
        // Standing where nothing is in the way does not count.
        steps(&mut tries, TRIED_S, 60.0, 3.5, false);
        assert!(!tries.are_exhausted());
        let now = steps(&mut tries, TRIED_S + 60.0, 2.0, 3.9, true);
        assert!(tries.are_exhausted() && tries.have_failed(now));
        steps(&mut tries, TRIED_S + 62.0, 1.0, 4.2, true);
        assert!(!tries.are_exhausted());
    }
}
