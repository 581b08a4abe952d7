//! While the walker is moving: which direction is due, the wrong way, and the corridor.

use super::{Follower, Now, STUCK_BESIDE_M, since};
use crate::cue::CueKind;
use crate::ground::heading_of;

/// A walker who has moved this far along the route is no longer stuck, metres.
const UNSTUCK_M: f64 = 1.5;

impl Follower {
    pub(crate) fn moving(&mut self, now: &Now) -> Option<CueKind> {
        self.update_counters(now);
        let aim = now.walker.turn_to(self.aim(now));
        if self.at_end(now) {
            return self.ending(now, aim);
        }
        self.arrival(now)
            .or_else(|| self.turn_now(now))
            .or_else(|| self.wrong_way(now, aim))
            .or_else(|| self.step_aside(now))
            .or_else(|| self.stopped(now, aim))
            .or_else(|| self.off_path(now, aim))
            .or_else(|| self.approach(now))
            .or_else(|| self.near_end(now))
            .or_else(|| self.adjust(now, aim))
            .or_else(|| self.check_behind(now))
            .or_else(|| self.slow_down(now))
            .or_else(|| self.progress(now))
            .or_else(|| self.tick(now, aim))
    }

    /// Updates the counters for going the wrong way, being off the path and being stuck.
    fn update_counters(&mut self, now: &Now) {
        let wrong = now.walker.turn_to(now.at.heading).abs().to_degrees() > self.config.wrong_way_deg;
        self.memory.wrong_m = if wrong { self.memory.wrong_m + self.motion.last_step() } else { 0.0 };
        let limit = self.config.off_m - if self.memory.off { self.config.off_hysteresis_m } else { 0.0 };
        if now.at.cross_m.abs() <= limit {
            self.memory.off_since = None;
        } else if now.speed > self.config.motion.standing_m_s {
            self.memory.off_since.get_or_insert(now.stamp);
        }
        let beside = now.at.cross_m.abs() > STUCK_BESIDE_M;
        let unstuck = |along_m: f64| (now.at.along_m - along_m).abs() > UNSTUCK_M;
        self.memory.stuck = self.memory.stuck.filter(|(along_m, _)| beside && !unstuck(*along_m));
    }

    fn wrong_way(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        let again = since(self.memory.wrong_said, now.stamp) >= self.config.wrong_way_again_s;
        if self.memory.wrong_m <= self.config.wrong_way_m || !again {
            return None;
        }
        self.memory.wrong_m = 0.0;
        self.memory.wrong_said = Some(now.stamp);
        self.turn_on_spot(now);
        Some(CueKind::WrongWay(aim))
    }

    fn off_path(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        let Some(off_since) = self.memory.off_since else {
            let was_off = std::mem::replace(&mut self.memory.off, false);
            return was_off.then_some(CueKind::BackOnPath);
        };
        if now.stamp - off_since < self.config.off_dwell_s || now.speed <= self.config.motion.standing_m_s {
            return None;
        }
        // A turn directly ahead will set the course again.
        if self.next_maneuver().is_some() && self.next_at_m() - now.at.along_m < 2.0 {
            return None;
        }
        // A walker who got a direction a moment ago, or is already returning, needs no more words.
        let off_deg = aim.abs().to_degrees();
        let returns = now.walker.turn_to(now.at.heading) * now.at.cross_m > 0.0;
        let directed = since(self.memory.last_direction, now.stamp) < self.config.adjust_again_s;
        if directed || returns && off_deg < self.config.adjust_deg || self.turns_away(now, aim) {
            return None;
        }
        let first = self.next == 0;
        let pause = if first { self.config.off_again_first_s } else { self.config.off_again_s };
        if self.memory.off && since(self.memory.off_said, now.stamp) < pause {
            return None;
        }
        self.memory.off = true;
        self.memory.off_said = Some(now.stamp);
        let to_path = now.at.foot - now.walker.position;
        let bearing = now.walker.turn_to(heading_of(&to_path));
        let turn = if off_deg > self.config.adjust_turn_deg {
            self.turn_on_spot(now);
            aim
        } else {
            self.direction_given(now);
            if off_deg > 0.6 * self.config.adjust_deg { aim } else { 0.0 }
        };
        Some(CueKind::OffPath {
            distance_m: to_path.norm(),
            bearing_rad: bearing,
            turn_rad: turn,
            on_spot: off_deg > self.config.adjust_turn_deg,
        })
    }
}
