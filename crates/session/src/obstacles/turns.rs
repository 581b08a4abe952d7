//! Whether a walker turns in vain: what is free is narrower than turns by words are exact.
//!
//! In: at each look where he stands, and whether the guide turns him about where he is to go. Out: whether to lead him elsewhere first.

use super::seconds_since;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// Who has been turned about where he is to go for so long, seconds, without being sent on, turns in vain ...
const LONGEST_S: f64 = 12.0;
/// ... until he stands so far from there, metres.
const ELSEWHERE_M: f64 = 0.12;

/// The turns of a walker at one place.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Turns {
    turned_s: f64,
    last: Option<Stamp>,
    vain: Option<Vec2>,
}

impl Turns {
    /// Takes a look at a walker who is here: whether he stands and is being turned, and whether he faces about where he is to go.
    pub fn step(&mut self, here: Vec2, turns: bool, about: bool, now: Stamp) {
        let dt = seconds_since(&mut self.last, now);
        self.turned_s = match (turns, about) {
            (true, true) => self.turned_s + dt,
            (true, false) => self.turned_s,
            (false, _) => 0.0,
        };
        if self.turned_s >= LONGEST_S {
            self.vain = Some(here);
        }
        self.vain = self.vain.filter(|at| (at - here).norm() < ELSEWHERE_M);
    }

    /// Whether turning here does not help.
    pub fn are_in_vain(&self) -> bool {
        self.vain.is_some()
    }

    /// He is led on from here.
    pub fn clear(&mut self) {
        (self.turned_s, self.vain) = (0.0, None);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_is_turned_for_long_turns_in_vain_until_he_stands_elsewhere() {
        let (mut turns, mut now) = (Turns::default(), 0.0);
        let mut step = |turns: &mut Turns, seconds: f64, x: f64, turning: bool, about: bool| {
            for _ in 0..(10.0 * seconds) as usize {
                now += 0.1;
                turns.step(Vec2::new(x, 0.0), turning, about, Stamp::from_seconds(now));
            }
        };
        step(&mut turns, 20.0, 0.0, true, false);
        step(&mut turns, 10.0, 0.0, true, true);
        assert!(!turns.are_in_vain(), "a long turn around");
        step(&mut turns, 5.0, 0.0, false, true);
        step(&mut turns, 11.0, 0.0, true, true);
        assert!(!turns.are_in_vain(), "he went on in between");
        step(&mut turns, 2.0, 0.0, true, true);
        assert!(turns.are_in_vain());
        step(&mut turns, 2.0, 0.05, false, false);
        assert!(turns.are_in_vain(), "he stands there still");
        step(&mut turns, 0.1, 0.2, false, false);
        assert!(!turns.are_in_vain());
    }
}
