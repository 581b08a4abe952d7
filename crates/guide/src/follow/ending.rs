//! The last metres: arrive, or what to do when the end was missed.

use super::{Follower, Now, Phase, Turning, since};
use crate::cue::CueKind;
use crate::ground::heading_of;

/// A course that is off by more than this has missed the end, radians.
const MISSED_RAD: f64 = 0.8;
/// A "stop" and a turn cannot have been followed within this time, seconds.
const REACTION_S: f64 = 3.0;

impl Follower {
    /// Near the end: arrive, or stop and turn to it. A walker who keeps going would circle round it.
    pub(crate) fn ending(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        let to_end = self.plan.end() - now.walker.position;
        let turn = now.walker.turn_to(heading_of(&to_end));
        let missed = turn.abs() > MISSED_RAD;
        if !missed || since(self.memory.last_direction, now.stamp) < REACTION_S {
            if missed {
                return None;
            }
            let stuck = self.stopped(now, aim);
            // Told to go on, with the end ahead, and still standing: something blocks the last step.
            if stuck.is_some() && to_end.norm() <= self.config.arrival_box_m[0] {
                return Some(self.arrived());
            }
            return stuck.or_else(|| self.adjust(now, aim)).or_else(|| self.tick(now, aim));
        }
        self.direction_given(now);
        self.memory.ends_missed += 1;
        self.phase = Phase::Turning(Turning::new(now, false));
        Some(CueKind::EndMissed { distance_m: to_end.norm(), turn_rad: turn })
    }
}
