//! A maneuver of the route: it is announced, and it is time for it.

use super::{Follower, Now};
use crate::cue::CueKind;
use crate::matcher::Match;

/// From this turn angle on the legs before and after it are easily confused, radians.
const HAIRPIN_RAD: f64 = 0.5;

/// So near to a corner it can be cut, metres along the route.
const CUT_M: f64 = 3.0;
/// A corner that lies behind a walker by more than this was not missed by a late word: he has come past it another way, metres.
const BEHIND_M: f64 = 2.0;

impl Follower {
    /// Corners that lie well behind the walker are done: nobody is led back to them.
    pub(crate) fn leave_behind(&mut self, now: &Now) {
        while self.next_maneuver().is_some_and(|m| m.end_m + BEHIND_M < now.at.along_m) {
            self.next += 1;
        }
    }

    /// "Turn now" at the next maneuver, or only its waypoint when the walker already goes the right way.
    pub(crate) fn turn_now(&mut self, now: &Now) -> Option<CueKind> {
        let m = *self.next_maneuver()?;
        let before = self.next.checked_sub(1).map_or(0.0, |k| self.plan.maneuvers()[k].end_m);
        let s = &self.config;
        let latest = (s.turn_now_share * (m.at_m - before)).max(s.turn_now_min_m);
        // Walking backwards the first word is "stop", and it is followed at once.
        let early = if self.backwards() {
            s.turn_lead_s * now.speed
        } else {
            (s.turn_now_s * now.speed).clamp(s.turn_now_min_m, latest) + s.reaction_s * now.speed
        };
        let middle = 0.5 * (m.at_m + m.end_m);
        // Crossing its plane counts too, where the walker cuts or overshoots the corner.
        let is_ahead = middle - now.at.along_m > early && now.at.along_m < m.at_m - 1e-6;
        if is_ahead && !(m.turn_rad != 0.0 && self.cuts_corner(now, m.end_m)) {
            return None;
        }
        self.next += 1;
        if m.turn_rad.abs() > HAIRPIN_RAD {
            self.matcher.pass(m.at_m);
        }
        self.memory.leg_start_m = now.at.along_m;
        self.memory.announced_at_m = now.at.along_m;
        let turn = now.walker.turn_to(m.exit_heading);
        if m.turn_rad != 0.0 && turn.abs().to_degrees() >= 20.0 {
            self.turn_on_spot(now);
            return Some(CueKind::TurnNow { turn_rad: turn, stairs: m.stairs });
        }
        match m.stairs {
            Some(stairs) => Some(CueKind::StairsNow(stairs)),
            None => Some(CueKind::Waypoint),
        }
    }

    /// Where a walker is who goes on after a stop: past the next corner where he stands nearer to the leg after it. To send him
    /// on to the corner would be to send him away from the route.
    pub(crate) fn past_corner(&mut self, now: &Now) -> Match {
        let corner = self.next_maneuver().filter(|m| m.turn_rad != 0.0).map(|m| m.end_m);
        let position = &now.walker.position;
        let Some(corner_m) = corner.filter(|m| self.matcher.is_past(&self.plan, position, &now.at, *m))
        else {
            return now.at;
        };
        self.next += 1;
        self.matcher.pass(corner_m);
        self.update_match(&now.walker, now.stamp)
    }

    /// Whether the walker has left the path and come nearer to the leg after the next corner, at `corner_m`.
    fn cuts_corner(&self, now: &Now, corner_m: f64) -> bool {
        now.at.cross_m.abs() > self.config.off_m
            && corner_m - now.at.along_m <= CUT_M
            && self.matcher.is_past(&self.plan, &now.walker.position, &now.at, corner_m)
    }

    pub(crate) fn approach(&mut self, now: &Now) -> Option<CueKind> {
        let m = *self.next_maneuver()?;
        if self.memory.approached == Some(self.next) {
            return None;
        }
        let before = self.next.checked_sub(1).map_or(0.0, |k| self.plan.maneuvers()[k].end_m);
        let segment = m.at_m - before;
        let s = &self.config;
        let faster = s.approach_per_speed * (now.speed - 1.0).max(0.0);
        let far = if m.stairs.is_some() { s.approach_stairs_m } else { s.approach_m } + faster;
        let wanted = segment >= s.approach_segment_m || m.stairs.is_some();
        if !wanted || m.at_m - now.at.along_m > far.min(0.5 * segment) {
            return None;
        }
        self.memory.approached = Some(self.next);
        self.memory.announced_at_m = now.at.along_m;
        Some(CueKind::Approach(self.ahead(now)))
    }
}
