//! Arrival: said early by the walker's reaction time; and the announcement of the end.

use super::{Follower, Now, Phase};
use crate::cue::CueKind;
use crate::ground::{cross, direction};

/// Within this distance only the end matters, metres.
const END_ZONE_M: f64 = 2.5;
/// Whoever stands farther from the end than this has not arrived, metres.
const ARRIVED_M: f64 = 1.0;
/// So near to the end nobody goes on by himself after a turn: who is fast passes it before he has heard to stop, metres.
const HELD_M: f64 = 1.5;
/// A walker who missed the end this often has arrived when it is within reach, whatever direction he faces.
const MISSES_BEFORE_ARRIVAL: u32 = 2;

impl Follower {
    /// The arrival cue, when the walker would stand at the end if told now.
    pub(crate) fn arrival(&mut self, now: &Now) -> Option<CueKind> {
        let end = self.plan.end();
        let to_end = end - now.walker.position;
        if self.next < self.plan.maneuvers().len() || self.plan.length() - now.at.along_m > 4.0 {
            return None;
        }
        let [width, depth, height] = self.config.arrival_box_m;
        let level = (now.walker.height - self.plan.height_at(self.plan.length())).abs() <= height;
        let course = direction(now.walker.course);
        let (ahead, miss) = (to_end.dot(&course), cross(&course, &to_end).abs());
        let standing_there = to_end.norm() <= 0.5 * width.min(depth);
        // Beside or past the end and within reach of it: sending the walker round for less than a metre does not help.
        let will_stand = course * (now.speed * self.config.arrival_lead_s);
        let will_miss_m = (to_end - will_stand).norm();
        let reach = will_miss_m <= self.config.arrival_reach_m;
        let beside = reach && ahead < 0.5 * to_end.norm();
        let early = (now.speed * self.config.arrival_lead_s).max(0.5 * depth);
        let spread = now.speed * self.config.arrival_spread_s;
        let reach_m = (self.config.arrival_reach_m.powi(2) - spread.powi(2)).max(0.1).sqrt();
        let soon = ahead <= early && miss <= reach_m;
        // A walker who missed it repeatedly does not get nearer: where the map has drifted, the end may lie in a wall.
        let tried = self.memory.ends_missed >= MISSES_BEFORE_ARRIVAL && reach;
        let will_stand_there = will_miss_m <= ARRIVED_M;
        (level && will_stand_there && (standing_there || soon || beside || tried)).then(|| self.arrived())
    }

    pub(crate) fn arrived(&mut self) -> CueKind {
        self.phase = Phase::Done;
        CueKind::Arrived
    }

    /// The end is near and the walker fast: a slow walker stops on the word, a fast one a metre later.
    pub(crate) fn near_end(&mut self, now: &Now) -> Option<CueKind> {
        let left = self.plan.length() - now.at.along_m;
        let s = &self.config;
        let wanted = self.next_maneuver().is_none()
            && !self.memory.end_announced
            && now.speed > s.end_speed
            && left < s.end_m;
        if !wanted || left < 0.5 * s.end_m {
            return None;
        }
        self.memory.end_announced = true;
        self.memory.announced_at_m = now.at.along_m;
        // "Slow down" is heard before a correction.
        self.correct_soon(now);
        Some(CueKind::Approach(self.ahead(now)))
    }

    /// Whether a walker who turns must stand before he goes on: the end is too near to be told in time.
    pub(crate) fn is_held_before_end(&self, now: &Now) -> bool {
        self.next_maneuver().is_none() && (self.plan.end() - now.walker.position).norm() < HELD_M
    }

    /// True when only the end lies ahead and it is near.
    pub(crate) fn at_end(&self, now: &Now) -> bool {
        let near = (self.plan.end() - now.walker.position).norm() < END_ZONE_M;
        let left = self.plan.length() - now.at.along_m;
        self.next_maneuver().is_none() && left < END_ZONE_M && (near || left < 0.3) && !self.backwards()
    }
}
