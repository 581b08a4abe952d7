//! The walker's motion over the last few seconds of poses: speed, turn rate, standing still.

use crate::facing::Heading;
use crate::ground::wrap;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;
use std::collections::VecDeque;

/// Time, position and heading of the last few seconds.
#[derive(Clone, Debug, Default)]
pub(crate) struct MotionHistory {
    history: VecDeque<(Stamp, Vec2, f64)>,
}

/// Seconds of history.
const HISTORY_S: f64 = 8.0;

impl MotionHistory {
    /// Clears the history; after a stop or a jump.
    pub fn clear(&mut self) {
        self.history.clear();
    }

    /// Adds an entry; one that is not newer than the last is ignored.
    pub fn push(&mut self, stamp: Stamp, walker: &Heading) {
        if self.history.back().is_some_and(|(t, ..)| *t >= stamp) {
            return;
        }
        self.history.push_back((stamp, walker.position, walker.heading));
        while self.history.front().is_some_and(|(t, ..)| stamp - *t > HISTORY_S) {
            self.history.pop_front();
        }
    }

    /// The entry nearest to `seconds` ago, at least that old if there is one.
    fn ago(&self, seconds: f64) -> Option<&(Stamp, Vec2, f64)> {
        let (now, ..) = self.history.back()?;
        self.history.iter().rev().find(|(t, ..)| *now - *t >= seconds).or(self.history.front())
    }

    /// Speed over ground in m/s, over the last 0.8 s.
    pub fn speed(&self) -> f64 {
        let (Some(b), Some(a)) = (self.history.back(), self.ago(0.8)) else { return 0.0 };
        let dt = b.0 - a.0;
        if dt > 0.1 { (b.1 - a.1).norm() / dt } else { 0.0 }
    }

    /// Turn rate in rad/s, positive to the left, over the last 0.3 s.
    pub fn turn_rate(&self) -> f64 {
        let (Some(b), Some(a)) = (self.history.back(), self.ago(0.3)) else { return 0.0 };
        let dt = b.0 - a.0;
        if dt > 0.05 { wrap(b.2 - a.2) / dt } else { 0.0 }
    }

    /// Metres between the last two entries.
    pub fn last_step(&self) -> f64 {
        let n = self.history.len();
        if n < 2 { 0.0 } else { (self.history[n - 1].1 - self.history[n - 2].1).norm() }
    }

    /// True when the walker stayed within `metres` for `seconds`.
    pub fn is_stationary(&self, seconds: f64, metres: f64) -> bool {
        let (Some(last), Some(first)) = (self.history.back(), self.history.front()) else { return false };
        last.0 - first.0 >= seconds
            && self
                .history
                .iter()
                .rev()
                .take_while(|(t, ..)| last.0 - *t <= seconds)
                .all(|(_, p, _)| (p - last.1).norm() < metres)
    }
}
