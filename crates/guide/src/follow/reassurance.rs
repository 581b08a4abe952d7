//! Words for a walker who stands, and sounds and distances for one who is on course.

use super::{Follower, Now, since};
use crate::cue::CueKind;

/// A standing walker whose course is off by more than this is turned instead of reassured, radians.
const OFF_COURSE_RAD: f64 = 0.26;
/// Seconds until the words that send the walker on have been heard and followed.
const REACTION_S: f64 = 4.0;

impl Follower {
    pub(crate) fn stopped(&mut self, now: &Now, aim: f64) -> Option<CueKind> {
        if !self.motion.is_stationary(self.config.stopped_s, self.config.stopped_m) {
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

    pub(crate) fn progress(&mut self, now: &Now) -> Option<CueKind> {
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
        let on = aim.abs().to_degrees() <= self.config.cone_deg
            && now.speed > self.config.motion.standing_m_s
            && !self.memory.off;
        if !on || since(self.memory.ticked, now.stamp) < self.config.tick_s {
            return None;
        }
        self.memory.ticked = Some(now.stamp);
        Some(CueKind::OnCourse)
    }
}
