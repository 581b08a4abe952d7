//! While the walker turns on the spot: say "stop turning" early and check the result.

use super::steer::BEAR_DEG;
use super::{Follower, Now, Phase, Turning, since};
use crate::cue::CueKind;
use crate::facing::Facing;
use crate::ground::wrap;

/// Slower than this is not turning, rad/s.
const STILL_RAD_S: f64 = 0.15;
/// Whoever has turned by so much has begun, however slowly, radians.
const TURNED_RAD: f64 = 0.35;
/// Seconds within which a new direction cannot have been heard and followed.
const REACTION_S: f64 = 1.0;
/// Seconds without turning after which a turn has ended.
const SETTLE_S: f64 = 0.5;
/// Seconds after which a turn that the walker did not begin is said again.
const REPEAT_S: f64 = 6.0;
/// Seconds after which a turn is given up in any case.
const TIMEOUT_S: f64 = 12.0;
/// So far from the aim a turn may end that is ended by words: at 45 degrees a second, half of the spread of the time in which
/// people react to them (0.3 to 1.2 s), degrees.
const TURN_ENDS_DEG: f64 = 20.0;
/// Below this, bearing ends nearer to the aim than turning slightly, degrees.
const SLIGHT_DEG: f64 = 32.0;
/// Nobody is told to turn for less, degrees.
const LEAST_TURN_DEG: f64 = 5.0;

impl Follower {
    pub(crate) fn turning(&mut self, mut turning: Turning, now: &Now) -> Option<CueKind> {
        let rate = self.motion.turn_rate();
        let left = now.walker.turn_to(self.aim(now));
        // A correction may still be in progress while the words are heard: that is not this turn, and no part of it.
        if now.stamp - turning.said <= REACTION_S {
            turning.from = now.walker.heading;
        } else {
            let turned = wrap(now.walker.heading - turning.from).abs() > TURNED_RAD;
            turning.began |= rate.abs() > 2.0 * STILL_RAD_S || turned;
        }
        if turning.began && !turning.stop_said && !turning.held && self.overtakes(left, rate) {
            if !self.may_end_anywhere(now) || self.is_held_before_end(now) {
                turning.held = true;
                self.phase = Phase::Turning(turning);
                return Some(CueKind::StandStill);
            }
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
        let is_told = turning.began && !turning.stop_said && !turning.held;
        if !is_told || since(self.memory.ticked, now.stamp) < self.config.tick_s {
            return None;
        }
        self.memory.ticked = Some(now.stamp);
        Some(CueKind::Turning(left))
    }

    /// True when at this rate the walker will have turned far enough before he can stop.
    fn overtakes(&self, left: f64, rate: f64) -> bool {
        // Above a right angle the sign of the rest is not reliable yet: a turn around passes 180 degrees.
        let near = left.abs().to_degrees() < 100.0;
        near && rate * left > 0.0 && (rate * self.config.turn_lead_s).abs() >= left.abs()
            || near && rate * left < 0.0 && left.abs().to_degrees() < 60.0 && rate.abs() > 2.0 * STILL_RAD_S
    }

    /// A turn as it is told where it must be exact, because somebody watches the way: people who are told to bear turn by about
    /// [`BEAR_DEG`], and those who are told to turn slightly, by far more.
    pub(crate) fn worded(&self, turn: f64) -> f64 {
        let bears = self.way.is_some() && turn.abs().to_degrees() < SLIGHT_DEG;
        if bears { turn.signum() * turn.abs().min(BEAR_DEG.to_radians()) } else { turn }
    }

    /// Whether the walker may walk on in any heading in which a turn to the aim may end.
    fn may_end_anywhere(&self, now: &Now) -> bool {
        let aim = self.aim(now);
        self.way.as_ref().is_none_or(|way| way.admits_within(aim, TURN_ENDS_DEG.to_radians()))
    }

    /// The turn has ended: go on, or turn further.
    fn turned(&mut self, turning: &Turning, left: f64, now: &Now) -> Option<CueKind> {
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        let off = left.abs().to_degrees();
        let small: f64 = if turning.goes_on() { 60.0 } else { 45.0 };
        let admitted = self.may_set_out(now);
        if !admitted && off < LEAST_TURN_DEG {
            // He faces where he is to go, and it is not free at this moment: the watch says so, or leads elsewhere.
            return None;
        }
        if !admitted || off > small.max(self.config.turn_tolerance_deg) {
            // Already where the next turn begins: make that turn.
            if let Some(turn @ CueKind::TurnNow { .. }) = self.turn_now(now) {
                return Some(turn);
            }
            let moving = turning.goes_on();
            self.phase = Phase::Turning(Turning::new(now, moving));
            self.memory.last_direction = Some(now.stamp);
            return Some(CueKind::Rotate(self.worded(left)));
        }
        let check = self.config.facing == Facing::Backwards;
        self.set_out(now);
        self.correct_soon(now);
        (!turning.stop_said).then(|| CueKind::Go { ahead: self.ahead(now), check })
    }
}
