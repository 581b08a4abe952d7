//! How the walker moves, from the last few seconds of poses: speed, turn rate, standing.

use crate::facing::Heading;
use crate::ground::wrap;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;
use std::collections::VecDeque;

/// The last seconds of stances.
#[derive(Clone, Debug, Default)]
pub(crate) struct Motion {
    past: VecDeque<(Stamp, Vec2, f64)>,
}

/// Seconds kept.
const KEPT: f64 = 8.0;

impl Motion {
    /// Forgets everything; after a stop or a jump.
    pub fn clear(&mut self) {
        self.past.clear();
    }

    /// Takes a stance; one that is not newer than the last is ignored.
    pub fn push(&mut self, stamp: Stamp, heading_kind: &Heading) {
        if self.past.back().is_some_and(|(t, ..)| *t >= stamp) {
            return;
        }
        self.past.push_back((stamp, heading_kind.position, heading_kind.heading));
        while self.past.front().is_some_and(|(t, ..)| stamp - *t > KEPT) {
            self.past.pop_front();
        }
    }

    /// The stance nearest to `seconds` ago, at least that old if there is one.
    fn ago(&self, seconds: f64) -> Option<&(Stamp, Vec2, f64)> {
        let (now, ..) = self.past.back()?;
        self.past.iter().rev().find(|(t, ..)| *now - *t >= seconds).or(self.past.front())
    }

    /// Speed over ground in m/s, over the last 0.8 s.
    pub fn speed(&self) -> f64 {
        let (Some(b), Some(a)) = (self.past.back(), self.ago(0.8)) else { return 0.0 };
        let dt = b.0 - a.0;
        if dt > 0.1 { (b.1 - a.1).norm() / dt } else { 0.0 }
    }

    /// Turn rate in rad/s, positive to the left, over the last 0.3 s.
    pub fn turn_rate(&self) -> f64 {
        let (Some(b), Some(a)) = (self.past.back(), self.ago(0.3)) else { return 0.0 };
        let dt = b.0 - a.0;
        if dt > 0.05 { wrap(b.2 - a.2) / dt } else { 0.0 }
    }

    /// Metres between the last stance and the one before it.
    pub fn last_step(&self) -> f64 {
        let n = self.past.len();
        if n < 2 { 0.0 } else { (self.past[n - 1].1 - self.past[n - 2].1).norm() }
    }

    /// True when for `seconds` the walker stayed within `metres`.
    pub fn stood(&self, seconds: f64, metres: f64) -> bool {
        let (Some(last), Some(first)) = (self.past.back(), self.past.front()) else { return false };
        last.0 - first.0 >= seconds
            && self
                .past
                .iter()
                .rev()
                .take_while(|(t, ..)| last.0 - *t <= seconds)
                .all(|(_, p, _)| (p - last.1).norm() < metres)
    }
}
