//! While the walker turns on the spot: say "stop turning" early, see that it was right.

use crate::cue::CueKind;
use crate::facing::Facing;
use crate::guide::{Guide, Now, Phase};
use cairn_sensor::Stamp;

/// A turn being made.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turning {
    /// When it was told.
    said: Stamp,
    /// The walker began to turn.
    began: bool,
    /// "Stop turning" was said; with it, what comes next.
    stop_said: bool,
    /// Standing still since.
    still_since: Option<Stamp>,
    /// The walker was moving when told and goes on by himself.
    moving: bool,
}

/// Slower than this is not turning, rad/s.
const STILL: f64 = 0.15;
/// Seconds in which nobody can have heard and followed a new direction.
const HEARD: f64 = 1.0;
/// Seconds without turning after which a turn has ended.
const SETTLED: f64 = 0.5;
/// Seconds after which a turn that nobody began is told again.
const UNHEARD: f64 = 6.0;
/// Seconds after which a turn is given up, whatever happens.
const LONGEST: f64 = 12.0;

impl Turning {
    /// A turn told now; `moving` when the walker will go on by himself after it.
    pub fn new(now: &Now, moving: bool) -> Self {
        Self { said: now.stamp, began: false, stop_said: false, still_since: None, moving }
    }
}

impl Guide {
    pub(crate) fn turning(&mut self, mut turning: Turning, now: &Now) -> Option<CueKind> {
        let rate = self.motion.turn_rate();
        let left = now.heading_kind.turn_to(self.aim(now));
        // A small correction may still be under way while the words are heard: that is not this turn.
        turning.began |= now.stamp - turning.said > HEARD && rate.abs() > 2.0 * STILL;
        if turning.began && !turning.stop_said && self.overtakes(left, rate) {
            turning.stop_said = true;
            self.phase = Phase::Turning(turning);
            return Some(CueKind::StopTurning(self.ahead(now)));
        }
        if rate.abs() > STILL {
            turning.still_since = None;
        } else if turning.still_since.is_none() {
            turning.still_since = Some(now.stamp);
        }
        self.phase = Phase::Turning(turning);
        let waited = now.stamp - turning.said;
        let ended = turning.began && turning.still_since.is_some_and(|t| now.stamp - t >= SETTLED);
        if ended || waited > LONGEST {
            return self.turned(&turning, left, now);
        }
        if !turning.began && waited > UNHEARD {
            return self.turned(&turning, left, now);
        }
        None
    }

    /// True when at this rate the walker will have turned far enough before he can stop.
    fn overtakes(&self, left: f64, rate: f64) -> bool {
        // Above a right angle the sign of what is left says nothing yet: a turn around passes 180 degrees.
        let near = left.abs().to_degrees() < 100.0;
        near && rate * left > 0.0 && (rate * self.config.turn_lead_s).abs() >= left.abs()
            || near && rate * left < 0.0 && left.abs().to_degrees() < 60.0 && rate.abs() > 2.0 * STILL
    }

    /// The turn has ended: go on, or turn some more.
    fn turned(&mut self, turning: &Turning, left: f64, now: &Now) -> Option<CueKind> {
        let off = left.abs().to_degrees();
        let small: f64 = if turning.stop_said || turning.moving { 60.0 } else { 45.0 };
        if off > small.max(self.config.turn_tolerance_deg) {
            // Already where the next turn begins: that turn is the one to make.
            if let Some(turn @ CueKind::TurnNow { .. }) = self.turn_now(now) {
                return Some(turn);
            }
            let moving = turning.stop_said || turning.moving;
            self.phase = Phase::Turning(Turning::new(now, moving));
            self.memory.directed = Some(now.stamp);
            return Some(CueKind::Rotate(left));
        }
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        let check = self.config.facing == Facing::Backwards;
        self.set_out(now);
        // What is left of the error shows at once.
        let rest = self.config.adjust_again_s - self.config.adjust_after_turn_s;
        self.memory.directed = Some(now.stamp.plus_seconds(-rest));
        (!turning.stop_said).then(|| CueKind::Go { ahead: self.ahead(now), check })
    }
}
