//! A walker who is led to and fro: tracking says that all is well, he walks, and comes no farther along the route.
//!
//! That happens where the map contradicts itself: it has one place twice, and the pose changes between the two as he turns. No
//! single direction is wrong by its pose. So what he has walked is compared with what he has gained: as long as he walks and
//! turns back, again and again, without coming farther than before, nothing gets better by going on. He is told so, with what helps,
//! and directions begin again once he has come on along the route.

use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// Farther along the route than ever before by this is progress, metres.
const PROGRESS_M: f64 = 2.0;
/// Without progress the walker is led on for so many metres, ...
const WALKED_M: f64 = 12.0;
/// ... so many seconds, ...
const SECONDS: f64 = 30.0;
/// ... and so often from going on to going back and again.
const REVERSALS: u32 = 3;
/// So far along the route the other way is a reversal, metres.
const SWING_M: f64 = 1.0;
/// Shorter than this is the noise of poses and the sway of somebody who stands, metres.
const STRIDE_M: f64 = 0.3;

/// What a walker has walked since he was farthest along the route.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct ToAndFro {
    since: Option<Since>,
}

/// Since the last progress.
#[derive(Clone, Copy, Debug)]
struct Since {
    stamp: Stamp,
    /// How far along the route he was then.
    along_m: f64,
    /// Metres walked since, and where that was counted last.
    walked_m: f64,
    counted: Vec2,
    /// The farthest point along the route in the present direction, whether that is towards the end, and how often it changed.
    turn_m: f64,
    onward: bool,
    reversals: u32,
}

impl ToAndFro {
    /// Takes where the walker is: metres along the route, and on the ground.
    pub fn step(&mut self, now: Stamp, along_m: f64, position: Vec2) {
        let begin = Since {
            stamp: now,
            along_m,
            walked_m: 0.0,
            counted: position,
            turn_m: along_m,
            onward: true,
            reversals: 0,
        };
        let since = self.since.get_or_insert(begin);
        if along_m > since.along_m + PROGRESS_M {
            *since = begin;
            return;
        }
        let moved = (position - since.counted).norm();
        if moved >= STRIDE_M {
            since.walked_m += moved.min(2.0 * STRIDE_M);
            since.counted = position;
        }
        let gained = if since.onward { along_m - since.turn_m } else { since.turn_m - along_m };
        if gained > 0.0 {
            since.turn_m = along_m;
        } else if gained < -SWING_M {
            (since.turn_m, since.onward) = (along_m, !since.onward);
            since.reversals += 1;
        }
    }

    /// The same places are farther along the route by so many metres from now on: a correction has changed its length.
    pub fn shift(&mut self, metres: f64) {
        if let Some(since) = &mut self.since {
            since.along_m += metres;
            since.turn_m += metres;
        }
    }

    /// The poses from now on have nothing to do with those before.
    pub fn begin_segment(&mut self) {
        self.since = None;
    }

    /// Whether a walker so far along the route would only be led to and fro.
    pub fn is_final_at(&self, along_m: f64, now: Stamp) -> bool {
        self.since.is_some_and(|since| {
            let is_over = since.walked_m >= WALKED_M && now - since.stamp >= SECONDS;
            is_over && since.reversals >= REVERSALS && along_m <= since.along_m + PROGRESS_M
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Walks along a straight route by these metres, at 1 m/s; whether that is final at its end.
    fn after(legs: &[f64]) -> bool {
        let (mut watch, mut t, mut along) = (ToAndFro::default(), 0.0, 10.0);
        for leg in legs {
            for _ in 0..(leg.abs() / 0.1).round() as usize {
                (t, along) = (t + 0.1, along + 0.1 * leg.signum());
                watch.step(Stamp::from_seconds(t), along, Vec2::new(along, 0.3));
            }
        }
        watch.is_final_at(along, Stamp::from_seconds(t))
    }

    #[test]
    fn to_and_fro_without_progress_is_final_walking_on_is_not() {
        assert!(after(&[8.0, -4.0, 4.0, -4.0, 4.0, -4.0, 4.0, -4.0, 4.0]));
        assert!(!after(&[40.0]), "on and on");
        assert!(!after(&[8.0, -4.0, 4.0, -4.0, 12.0]), "two mistakes, then on");
        assert!(!after(&[30.0, -15.0, 30.0]), "a long way back, once");
        assert!(!after(&[5.0, -3.0, 6.0, -3.0, 6.0, -3.0, 6.0, -3.0, 6.0, -3.0, 6.0]), "each time farther");
    }

    /// A route of which the length settles behind the walker, as a map does whose scale becomes known: along it he jumps back and
    /// forth, and is exactly on it all the time.
    #[test]
    fn a_route_that_changes_its_length_behind_the_walker_leads_nobody_to_and_fro() {
        let (mut watch, mut along) = (ToAndFro::default(), 20.0);
        for n in 0..600 {
            let t = 0.1 * f64::from(n);
            along += 0.05;
            if n % 60 == 59 {
                let longer = if n % 120 == 59 { -4.0 } else { 1.5 };
                along += longer;
                watch.shift(longer);
            }
            watch.step(Stamp::from_seconds(t), along, Vec2::new(0.05 * f64::from(n), 0.0));
            assert!(!watch.is_final_at(along, Stamp::from_seconds(t)), "after {t} s");
        }
    }

    #[test]
    fn one_who_stands_or_sways_is_not_led_anywhere() {
        let mut watch = ToAndFro::default();
        for n in 0..3000 {
            let (t, along) = (0.1 * f64::from(n), 5.0 + 0.12 * f64::from(n % 2));
            watch.step(Stamp::from_seconds(t), along, Vec2::new(along, 0.0));
            assert!(!watch.is_final_at(along, Stamp::from_seconds(t)));
        }
    }
}
