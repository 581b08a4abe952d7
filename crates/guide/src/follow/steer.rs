//! Small course corrections, from where the present course leads: said once, when they help most, and not at all
//! where the leg ends before the walker leaves the corridor.
//!
//! People answer "bear left" with nearly the same change of course each time, whatever the error was. A correction is
//! therefore held back until one such change leads back to the middle, unless the walker would leave the corridor
//! before; correcting each small error at once would send him from side to side.

use super::{Follower, Now, since};
use crate::cue::CueKind;
use crate::free_way::ANSWER_S;

/// The change of course that people make on "bear left", degrees.
pub(super) const BEAR_DEG: f64 = 19.0;
/// A correction must bring the walker nearer to the route by this share of his offset.
const WORTH: f64 = 0.3;

/// The predicted course over the rest of a leg: offset across the route (left positive) and where it leads.
#[derive(Clone, Copy, Debug)]
struct Course {
    cross_m: f64,
    /// Heading relative to the leg's, radians, positive to the left.
    off_rad: f64,
    rest_m: f64,
}

impl Course {
    /// Offset across the route after this many more metres.
    fn after(&self, metres: f64) -> f64 {
        self.cross_m + metres.clamp(0.0, self.rest_m) * self.off_rad.sin()
    }

    /// Offset across the route at the end of the leg.
    fn end(&self) -> f64 {
        self.after(self.rest_m)
    }

    /// The same course when the walker bears by `turn_rad` after `metres`.
    fn bent(&self, metres: f64, turn_rad: f64) -> f64 {
        let metres = metres.clamp(0.0, self.rest_m);
        self.after(metres) + (self.rest_m - metres) * (self.off_rad + turn_rad).sin()
    }

    /// Metres from here at which bearing by `turn_rad` leads to the route just at the leg's end.
    fn best(&self, turn_rad: f64) -> f64 {
        let (now, bent) = (self.off_rad.sin(), (self.off_rad + turn_rad).sin());
        if (now - bent).abs() < 1e-6 { 0.0 } else { -(self.cross_m + self.rest_m * bent) / (now - bent) }
    }
}

/// No correction against an aim that is off by more than this, degrees.
const AGAINST_DEG: f64 = 8.0;

impl Follower {
    /// A small correction before the walker leaves the corridor.
    pub(crate) fn adjust(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        // Between the bends of a corner the piece of route says nothing of the way that he was told to turn to.
        let wanted = if self.corner_here(now).is_some() { None } else { self.wanted(now, aim) };
        let turn = wanted.filter(|turn| !self.turns_away(now, *turn));
        let Some(turn) = turn.filter(|_| now.speed >= self.config.motion.standing_m_s) else {
            self.memory.aim_off_since = None;
            return None;
        };
        let s = &self.config;
        let off_since = *self.memory.aim_off_since.get_or_insert(now.stamp);
        let rested = since(self.memory.last_direction, now.stamp) >= s.adjust_again_s;
        if now.stamp - off_since < s.adjust_dwell_s || !rested || self.motion.turn_rate().abs() > 0.3 {
            return None;
        }
        if turn.abs().to_degrees() > s.adjust_turn_deg {
            self.turn_on_spot(now);
            return Some(CueKind::Rotate(turn));
        }
        // Not into what stands beside the way.
        let bears = turn.signum() * BEAR_DEG.to_radians();
        if !self.may_bear(now, bears) {
            return None;
        }
        self.direction_given(now);
        Some(CueKind::Adjust(turn))
    }

    /// Whether a turn leads whoever returns to the route from outside away from it. They are directed along it once they are inside,
    /// unless they come far too steeply.
    pub(crate) fn turns_away(&self, now: &Now, turn: f64) -> bool {
        let s = &self.config;
        let outside = now.at.cross_m.abs() > s.off_m && !self.backwards();
        let returns = now.walker.turn_to(now.at.heading) * now.at.cross_m > 0.0;
        outside && returns && turn * now.at.cross_m > 0.0 && turn.abs().to_degrees() <= s.adjust_far_deg
    }

    /// The turn that is wanted now, if any.
    fn wanted(&self, now: &Now, aim: f64) -> Option<f64> {
        let s = &self.config;
        let last = self.next_maneuver().is_none();
        let course = Course {
            cross_m: now.at.cross_m,
            off_rad: -now.walker.turn_to(self.leg_heading(now)),
            rest_m: (self.next_at_m() - now.at.along_m).max(0.0),
        };
        let off_deg = course.off_rad.abs().to_degrees();
        let answer_m = ANSWER_S * now.speed;
        if course.rest_m < answer_m + 0.5 || off_deg > s.wrong_way_deg {
            return None;
        }
        let aim_deg = aim.abs().to_degrees();
        if self.backwards() {
            // The corridor is narrow and the pace slow: each error of aim matters.
            let warned = now.at.cross_m.abs() > s.warn_m && aim * now.at.cross_m < 0.0;
            let limit = if warned { 0.6 } else { 1.0 } * s.backwards_adjust_deg;
            let near = course.rest_m < (3.0 * now.speed).max(1.6);
            return (aim_deg > limit && aim_deg <= s.wrong_way_deg && !near).then_some(aim);
        }
        // Far off course, or far off the route: the aim decides the direction.
        let outside = now.at.cross_m.abs() > s.off_m;
        if aim_deg > s.adjust_far_deg || outside && aim_deg > s.adjust_deg {
            return (aim_deg <= s.wrong_way_deg).then_some(aim);
        }
        let edge = s.edge_share * s.off_m;
        let leaves = course.after(s.adjust_ahead_m).abs() > edge && !(outside && returns(&course));
        let misses = last && course.end().abs() > s.end_miss_m;
        if !leaves && !misses {
            return None;
        }
        // Towards the route, from where the course leads.
        let led = if leaves { course.after(s.adjust_ahead_m) } else { course.end() };
        let turn = -led.signum() * BEAR_DEG.to_radians();
        let soon = course.after(answer_m + 0.5 * now.speed).abs() > edge;
        let bent = course.bent(answer_m, turn);
        // Never against the direction that the route just ahead needs: first return to the route.
        if aim * turn < 0.0 && aim_deg > AGAINST_DEG {
            return None;
        }
        let helps = bent.abs() < (1.0 - WORTH) * course.end().abs();
        let due = course.best(turn) <= answer_m;
        // On the way back to the middle there is time; on the way out, far off course, there is none.
        let outwards = course.off_rad * turn < 0.0;
        let much = off_deg > s.adjust_deg && outwards && course.after(answer_m) * course.off_rad > 0.0;
        let wanted = soon && leaves || much || due;
        (wanted && (helps || soon && outwards)).then_some(turn)
    }
}

/// True when the walker is returning to the route by himself at a sufficient angle.
fn returns(course: &Course) -> bool {
    course.cross_m * course.off_rad < 0.0 && course.off_rad.abs().to_degrees() > 5.0
}
