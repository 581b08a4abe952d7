//! Walking backwards: legs that end in a look behind, steps back to the line, and a pace that stays slow.

use super::{Follower, Now, Phase, Turning, since};
use crate::cue::{CueKind, Step};
use crate::ground::{cross, direction, wrap};
use cairn_sensor::Stamp;

/// A step aside must approach the line by at least this share of its length.
const STEP_GAIN: f64 = 0.45;
/// Beyond this many times the limit single steps no longer help.
const STEP_ASIDE_LIMIT: f64 = 2.5;

impl Follower {
    /// Whether the walker has stood for a second.
    fn has_stopped(&self) -> bool {
        self.motion.is_stationary(1.0, self.config.motion.standing_m_s)
    }

    pub(crate) fn check_behind(&mut self, now: &Now) -> Option<CueKind> {
        let walked = now.at.along_m - self.memory.leg_start_m;
        let rest = self.next_at_m() - self.memory.leg_start_m;
        if !self.backwards() || walked < self.config.leg_m || rest <= self.config.leg_most_m {
            return None;
        }
        self.direction_given(now);
        self.phase = Phase::Checking { since: now.stamp };
        Some(CueKind::CheckBehind)
    }

    pub(crate) fn checking(&mut self, since: Stamp, now: &Now) -> Option<CueKind> {
        if now.stamp - since < self.config.check_s || !self.has_stopped() {
            return None;
        }
        self.turn_now(now).or_else(|| self.go_or_rotate(now))
    }

    pub(crate) fn step_aside(&mut self, now: &Now) -> Option<CueKind> {
        // After a turn the first step is off by the overshoot; the line is judged once the walker moves along it.
        let rested = since(self.memory.last_direction, now.stamp) >= 2.0;
        let off = self.off_line(now);
        if !self.backwards() || !rested || off.abs() <= self.config.backwards_off_m {
            return None;
        }
        if !self.is_beside(now) {
            return None;
        }
        // Already returning to the line: the path's left is the walker's right when he moves backwards.
        let towards = cross(&direction(now.at.heading), &direction(now.walker.course)) * now.at.cross_m < 0.0;
        let across = now.walker.turn_to(now.at.heading).abs().to_degrees();
        if towards && across > self.config.backwards_adjust_deg && across < 80.0 {
            return None;
        }
        let aimed = now.walker.turn_to(self.aim(now)).abs().to_degrees() < self.config.adjust_deg;
        if aimed && off.abs() > STEP_ASIDE_LIMIT * self.config.backwards_off_m {
            return None;
        }
        self.aside(now)
    }

    /// Metres from the walker to the line, across it, to the walker's own left. Only the part across the line: a
    /// walker who stands beyond a corner is not off the line by that distance.
    fn off_line(&self, now: &Now) -> f64 {
        let left = direction(now.at.heading + std::f64::consts::FRAC_PI_2);
        let across = left * (now.at.foot - now.walker.position).dot(&left);
        now.walker.to_left(&(now.walker.position + across))
    }

    /// Whether the line is beside the walker: beyond a corner or the end it is not.
    fn is_beside(&self, now: &Now) -> bool {
        self.off_line(now) * now.walker.to_left(&now.at.foot) > 0.0
            && now.at.along_m <= self.plan.length() - 0.1
    }

    /// One step back towards the line; from farther away, or where such a step would hardly approach the line, a turn
    /// that leads back.
    fn aside(&mut self, now: &Now) -> Option<CueKind> {
        let aim = now.walker.turn_to(self.aim(now));
        let off = self.off_line(now);
        // "Back and to your side" is halfway between the two directions.
        let step = direction(now.walker.heading + off.signum() * 0.75 * std::f64::consts::PI);
        let across = (now.at.foot - now.walker.position).dot(&step);
        let gain = cross(&direction(now.at.heading), &step).abs();
        if across < 0.0 || gain < STEP_GAIN || off.abs() > STEP_ASIDE_LIMIT * self.config.backwards_off_m {
            self.direction_given(now);
            self.phase = Phase::Turning(Turning::new(now, false));
            return Some(CueKind::Rotate(aim));
        }
        self.direction_given(now);
        self.phase = Phase::SteppingAside { since: now.stamp };
        Some(CueKind::Step(Step::BackAside(self.off_line(now))))
    }

    pub(crate) fn stepping_aside(&mut self, since: Stamp, now: &Now) -> Option<CueKind> {
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        if now.stamp - since < 3.5 || !self.has_stopped() {
            return None;
        }
        if let Some(kind) = self.turn_now(now) {
            return Some(kind);
        }
        if self.off_line(now).abs() > 0.6 * self.config.backwards_off_m && self.is_beside(now) {
            return self.aside(now);
        }
        self.go_or_rotate(now)
    }

    /// From standing: go on, or turn first.
    fn go_or_rotate(&mut self, now: &Now) -> Option<CueKind> {
        let aim = wrap(now.walker.turn_to(self.aim(now)));
        if aim.abs().to_degrees() > self.config.turn_tolerance_deg {
            self.direction_given(now);
            self.phase = Phase::Turning(Turning::new(now, false));
            return Some(CueKind::Rotate(aim));
        }
        self.set_out(now);
        Some(CueKind::Go { ahead: self.ahead(now), check: false })
    }

    pub(crate) fn slow_down(&mut self, now: &Now) -> Option<CueKind> {
        if !self.backwards() || now.speed <= 1.1 * self.config.backwards_speed {
            self.memory.fast_since = None;
            return None;
        }
        let fast_since = *self.memory.fast_since.get_or_insert(now.stamp);
        let again = since(self.memory.fast_said, now.stamp) >= 6.0;
        if now.stamp - fast_since < 1.5 || !again {
            return None;
        }
        self.memory.fast_said = Some(now.stamp);
        Some(CueKind::SlowDown)
    }
}
