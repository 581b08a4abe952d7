//! While the walker turns on the spot: say "stop turning" early and check the result.

use super::{Follower, Now, Phase, Turning};
use crate::cue::CueKind;
use crate::facing::Facing;

/// Slower than this is not turning, rad/s.
const STILL_RAD_S: f64 = 0.15;
/// Seconds within which a new direction cannot have been heard and followed.
const REACTION_S: f64 = 1.0;
/// Seconds without turning after which a turn has ended.
const SETTLE_S: f64 = 0.5;
/// Seconds after which a turn that the walker did not begin is said again.
const REPEAT_S: f64 = 6.0;
/// Seconds after which a turn is given up in any case.
const TIMEOUT_S: f64 = 12.0;

impl Follower {
    pub(crate) fn turning(&mut self, mut turning: Turning, now: &Now) -> Option<CueKind> {
        let rate = self.motion.turn_rate();
        let left = now.walker.turn_to(self.aim(now));
        // A small correction may still be in progress while the words are heard: that is not this turn.
        turning.began |= now.stamp - turning.said > REACTION_S && rate.abs() > 2.0 * STILL_RAD_S;
        if turning.began && !turning.stop_said && self.overtakes(left, rate) {
            turning.stop_said = true;
            self.phase = Phase::Turning(turning);
            return Some(CueKind::StopTurning(self.ahead(now)));
        }
        if rate.abs() > STILL_RAD_S {
            turning.still_since = None;
        } else if turning.still_since.is_none() {
            turning.still_since = Some(now.stamp);
        }
        self.phase = Phase::Turning(turning);
        let waited = now.stamp - turning.said;
        let ended = turning.began && turning.still_since.is_some_and(|t| now.stamp - t >= SETTLE_S);
        if ended || waited > TIMEOUT_S {
            return self.turned(&turning, left, now);
        }
        if !turning.began && waited > REPEAT_S {
            return self.turned(&turning, left, now);
        }
        None
    }

    /// True when at this rate the walker will have turned far enough before he can stop.
    fn overtakes(&self, left: f64, rate: f64) -> bool {
        // Above a right angle the sign of the rest is not reliable yet: a turn around passes 180 degrees.
        let near = left.abs().to_degrees() < 100.0;
        near && rate * left > 0.0 && (rate * self.config.turn_lead_s).abs() >= left.abs()
            || near && rate * left < 0.0 && left.abs().to_degrees() < 60.0 && rate.abs() > 2.0 * STILL_RAD_S
    }

    /// The turn has ended: go on, or turn further.
    fn turned(&mut self, turning: &Turning, left: f64, now: &Now) -> Option<CueKind> {
        let off = left.abs().to_degrees();
        let small: f64 = if turning.stop_said || turning.moving { 60.0 } else { 45.0 };
        if off > small.max(self.config.turn_tolerance_deg) {
            // Already where the next turn begins: make that turn.
            if let Some(turn @ CueKind::TurnNow { .. }) = self.turn_now(now) {
                return Some(turn);
            }
            let moving = turning.stop_said || turning.moving;
            self.phase = Phase::Turning(Turning::new(now, moving));
            self.memory.last_direction = Some(now.stamp);
            return Some(CueKind::Rotate(left));
        }
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        let check = self.config.facing == Facing::Backwards;
        self.set_out(now);
        // The remaining error can be corrected soon after.
        let rest = self.config.adjust_again_s - self.config.adjust_after_turn_s;
        self.memory.last_direction = Some(now.stamp.plus_seconds(-rest));
        (!turning.stop_said).then(|| CueKind::Go { ahead: self.ahead(now), check })
    }
}
