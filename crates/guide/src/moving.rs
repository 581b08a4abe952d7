//! While the walker is moving: turns, corrections, corridor, wrong way, standing, progress, arrival.

use crate::cue::CueKind;
use crate::facing::Facing;
use crate::ground::{cross, direction, heading_of, wrap};
use crate::guide::{Guide, Now, Phase};
use crate::turning::Turning;
use cairn_sensor::Stamp;

/// From this turn angle on the legs before and after it are easily confused, radians.
const HAIRPIN_RAD: f64 = 0.5;
/// Slower than this counts as standing, m/s.
const STANDING_M_S: f64 = 0.15;

/// A standing walker whose course is off by more than this is turned instead of reassured, radians.
const OFF_COURSE_RAD: f64 = 0.26;

/// Seconds until the words that send the walker on have been heard and followed.
const REACTION_S: f64 = 4.0;

/// A stuck walker who is nearer to the route than this is on it, metres.
const STUCK_BESIDE_M: f64 = 0.5;
/// A walker who has moved this far along the route is no longer stuck, metres.
const UNSTUCK_M: f64 = 1.5;

/// A step aside must approach the line by at least this share of its length.
const STEP_GAIN: f64 = 0.45;

/// Beyond this many times the limit single steps no longer help.
const STEP_ASIDE_LIMIT: f64 = 2.5;

pub(crate) fn since(last: Option<Stamp>, now: Stamp) -> f64 {
    last.map_or(f64::INFINITY, |t| now - t)
}

impl Guide {
    pub(crate) fn backwards(&self) -> bool {
        self.config.facing == Facing::Backwards
    }

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
        } else if now.speed > STANDING_M_S {
            self.memory.off_since.get_or_insert(now.stamp);
        }
        let beside = now.at.cross_m.abs() > STUCK_BESIDE_M;
        let unstuck = |along_m: f64| (now.at.along_m - along_m).abs() > UNSTUCK_M;
        self.memory.stuck = self.memory.stuck.filter(|(along_m, _)| beside && !unstuck(*along_m));
    }

    /// True when the walker is stuck beside the route and is best led straight back to it, because an obstacle lies
    /// between him and the point ahead. Alternates with the point ahead while neither helps.
    pub(crate) fn stuck_beside_route(&self, now: &Now) -> bool {
        let beside = now.at.cross_m.abs() > STUCK_BESIDE_M && !self.backwards();
        beside && self.memory.stuck.is_some_and(|(_, told)| told % 4 >= 2)
    }

    pub(crate) fn direction_given(&mut self, now: &Now) {
        self.memory.last_direction = Some(now.stamp);
        self.memory.aim_off_since = None;
    }

    pub(crate) fn turn_on_spot(&mut self, now: &Now) {
        self.direction_given(now);
        self.phase = Phase::Turning(Turning::new(now, true));
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
        if middle - now.at.along_m > early && now.at.along_m < m.at_m - 1e-6 {
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

    fn approach(&mut self, now: &Now) -> Option<CueKind> {
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
        if now.stamp - off_since < self.config.off_dwell_s || now.speed <= STANDING_M_S {
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
        if directed || returns && off_deg < self.config.adjust_deg {
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

    pub(crate) fn stopped(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        if !self.motion.stood_still(self.config.stopped_s, self.config.stopped_m) {
            if now.speed > 0.2 {
                self.memory.stopped_said = None;
            }
            return None;
        }
        let times = match self.memory.stopped_said {
            None if since(self.memory.set_out, now.stamp) >= self.config.stopped_s + REACTION_S => 1,
            Some((at, 1)) if now.stamp - at >= self.config.stopped_again_s => 2,
            // A walker blocked by what he faces needs another direction for as long as he stands.
            Some((at, n)) if now.stamp - at >= self.config.stopped_again_s && aim.abs() > OFF_COURSE_RAD => n,
            _ => return None,
        };
        self.memory.stopped_said = Some((now.stamp, times));
        let (along_m, told) = self.memory.stuck.unwrap_or((now.at.along_m, 0));
        self.memory.stuck = Some((along_m, told + 1));
        let aim = now.walker.turn_to(self.aim(now));
        if aim.abs() > OFF_COURSE_RAD && !self.backwards() {
            self.turn_on_spot(now);
            return Some(CueKind::Rotate(aim));
        }
        let on_path = now.at.cross_m.abs() <= self.config.off_m;
        Some(CueKind::Stopped { ahead: self.ahead(now), on_path })
    }

    fn progress(&mut self, now: &Now) -> Option<CueKind> {
        let step = self.config.progress_m;
        if step == 0.0 {
            return None;
        }
        // Not when the approach of a turn or the end will announce the distance anyway.
        let soon = if self.next_maneuver().is_some() { self.config.approach_m + 3.0 } else { 3.0 };
        if now.at.along_m - self.memory.announced_at_m < step || self.next_at_m() - now.at.along_m < soon {
            return None;
        }
        self.memory.announced_at_m = now.at.along_m;
        Some(CueKind::Progress(self.ahead(now)))
    }

    pub(crate) fn tick(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        let on =
            aim.abs().to_degrees() <= self.config.cone_deg && now.speed > STANDING_M_S && !self.memory.off;
        if !on || since(self.memory.ticked, now.stamp) < self.config.tick_s {
            return None;
        }
        self.memory.ticked = Some(now.stamp);
        Some(CueKind::OnCourse)
    }

    // Walking backwards.

    fn check_behind(&mut self, now: &Now) -> Option<CueKind> {
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
        if now.stamp - since < self.config.check_s || !self.motion.stood_still(1.0, 0.15) {
            return None;
        }
        self.turn_now(now).or_else(|| self.go_or_rotate(now))
    }

    fn step_aside(&mut self, now: &Now) -> Option<CueKind> {
        // After a turn the first step is off by the overshoot; the line is judged once the walker moves along it.
        let rested = since(self.memory.last_direction, now.stamp) >= 2.0;
        let off = self.off_line(now);
        if !self.backwards() || !rested || off.abs() <= self.config.backwards_off_m {
            return None;
        }
        // Beyond a corner or the end the line is not beside the walker.
        if off * now.walker.to_left(&now.at.foot) <= 0.0 || now.at.along_m > self.plan.length() - 0.1 {
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

    /// One step back towards the line; from farther away, or where such a step would hardly approach the line, a turn
    /// that leads back.
    fn aside(&mut self, now: &Now) -> Option<CueKind> {
        let aim = now.walker.turn_to(self.aim(now));
        let off = self.off_line(now);
        // "Back and to your side" is halfway between the two directions.
        let step = direction(now.walker.heading + off.signum() * 0.75 * std::f64::consts::PI);
        let across = (now.at.foot - now.walker.position).dot(&step);
        let gain = cross(&direction(now.at.heading), &step).abs();
        if across < 0.0
            || gain < STEP_GAIN
            || off.abs() > STEP_ASIDE_LIMIT * self.config.backwards_off_m
            || now.at.along_m > self.plan.length() - 0.1
        {
            self.direction_given(now);
            self.phase = Phase::Turning(Turning::new(now, false));
            return Some(CueKind::Rotate(aim));
        }
        self.direction_given(now);
        self.phase = Phase::SteppingAside { since: now.stamp };
        Some(CueKind::StepAside(self.off_line(now)))
    }

    pub(crate) fn stepping_aside(&mut self, since: Stamp, now: &Now) -> Option<CueKind> {
        if let Some(arrived) = self.arrival(now) {
            return Some(arrived);
        }
        if now.stamp - since < 3.5 || !self.motion.stood_still(1.0, 0.15) {
            return None;
        }
        if let Some(kind) = self.turn_now(now) {
            return Some(kind);
        }
        if self.off_line(now).abs() > 0.6 * self.config.backwards_off_m {
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

    fn slow_down(&mut self, now: &Now) -> Option<CueKind> {
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
