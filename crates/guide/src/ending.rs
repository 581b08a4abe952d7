//! The last metres: the word to slow down, "stop" said early by the walker's reaction, and what to do when
//! the end was missed.

use crate::cue::CueKind;
use crate::ground::{cross, direction};
use crate::guide::{Guide, Now, Phase};
use crate::moving::since;
use crate::turning::Turning;

/// Within this of the end only the end counts, metres.
const LAST_M: f64 = 2.5;
/// A course that is off by more than this has missed the end, radians.
const MISSED: f64 = 0.8;
/// Who missed the end so often stands there when it is within reach, whichever way he faces.
const MISSED_MOST: u32 = 2;
/// Seconds in which nobody can have followed "stop" and a turn.
const HEARD: f64 = 3.0;

impl Guide {
    /// The walker will stand at the end of the way if told now.
    pub(crate) fn arrival(&mut self, now: &Now) -> Option<CueKind> {
        let end = self.plan.end();
        let to_end = end - now.heading_kind.position;
        if self.next < self.plan.maneuvers().len() || self.plan.length() - now.at.along_m > 4.0 {
            return None;
        }
        let [width, depth, height] = self.config.arrival_box_m;
        let level = (now.heading_kind.height - self.plan.height_at(self.plan.length())).abs() <= height;
        let course = direction(now.heading_kind.course);
        let (ahead, miss) = (to_end.dot(&course), cross(&course, &to_end).abs());
        let standing_there = to_end.norm() <= 0.5 * width.min(depth);
        // Beside or past the end and within reach of it: sending the walker round for less than a metre helps nobody.
        let will_stand = course * (now.speed * self.config.arrival_lead_s);
        let beside =
            (to_end - will_stand).norm() <= self.config.arrival_reach_m && ahead < 0.5 * to_end.norm();
        let early = (now.speed * self.config.arrival_lead_s).max(0.5 * depth);
        let spread = now.speed * self.config.arrival_spread_s;
        let most = (self.config.arrival_reach_m.powi(2) - spread.powi(2)).max(0.1).sqrt();
        let soon = ahead > -0.5 * depth && ahead <= early && miss <= most;
        // Who missed it time and again does not get nearer: the end as the map has it may lie in a wall.
        let reach = (to_end - will_stand).norm() <= self.config.arrival_reach_m;
        let tried = self.memory.ends_missed >= MISSED_MOST && reach;
        (level && (standing_there || soon || beside || tried)).then(|| self.arrived())
    }

    fn arrived(&mut self) -> CueKind {
        self.phase = Phase::Done;
        CueKind::Arrived
    }

    /// The end is near and the walker fast: a slow walker stands where told, a fast one a metre later.
    pub(crate) fn near_end(&mut self, now: &Now) -> Option<CueKind> {
        let left = self.plan.length() - now.at.along_m;
        let s = &self.config;
        let wanted =
            self.coming().is_none() && !self.memory.end_told && now.speed > s.end_speed && left < s.end_m;
        if !wanted || left < 0.5 * s.end_m {
            return None;
        }
        self.memory.end_told = true;
        self.memory.told_at_m = now.at.along_m;
        Some(CueKind::Approach(self.ahead(now)))
    }

    /// True when nothing but the end lies ahead and it is near.
    pub(crate) fn at_end(&self, now: &Now) -> bool {
        let near = (self.plan.end() - now.heading_kind.position).norm() < LAST_M;
        let left = self.plan.length() - now.at.along_m;
        self.coming().is_none() && left < LAST_M && (near || left < 0.3) && !self.backwards()
    }

    /// Near the end: arrive, or stop and turn to it. One who goes on circles round it.
    pub(crate) fn ending(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        let to_end = self.plan.end() - now.heading_kind.position;
        let turn = now.heading_kind.turn_to(crate::ground::heading_of(&to_end));
        let missed = turn.abs() > MISSED;
        if !missed || since(self.memory.directed, now.stamp) < HEARD {
            if missed {
                return None;
            }
            let held_up = self.stopped(now, aim);
            // Told to go on, with the end before him, and standing: something is there.
            if held_up.is_some() && to_end.norm() <= self.config.arrival_box_m[0] {
                return Some(self.arrived());
            }
            return held_up.or_else(|| self.tick(now, aim));
        }
        self.direct(now);
        self.memory.ends_missed += 1;
        self.phase = Phase::Turning(Turning::new(now, false));
        Some(CueKind::EndMissed { distance_m: to_end.norm(), turn_rad: turn })
    }
}
