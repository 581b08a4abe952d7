//! The walker on his route: what he is doing, what comes next, and the direction that helps him now.
//!
//! Here is what all phases share; each file beside this one has one kind of direction.

mod arrival;
mod at_maneuver;
mod backwards;
mod ending;
mod moving;
mod phase;
mod reassurance;
mod steer;
mod step;
mod turning;

pub(crate) use phase::{Now, Phase, Turning};

use crate::config::GuideConfig;
use crate::cue::{Next, UpcomingManeuver};
use crate::facing::{Facing, Heading};
use crate::free_way::FreeWay;
use crate::ground::heading_of;
use crate::maneuvers::{Maneuver, ManeuverPlan};
use crate::matcher::{Match, Matcher};
use crate::motion::MotionHistory;
use cairn_sensor::Stamp;
use phase::Memory;

/// A stuck walker who is nearer to the route than this is on it, metres.
const STUCK_BESIDE_M: f64 = 0.5;
/// Who is farther than this from the route is led to it even where a point on it is near, metres.
const BESIDE_M: f64 = 1.0;

/// Follows a walker along a plan.
#[derive(Clone, Debug)]
pub(crate) struct Follower {
    pub(crate) config: GuideConfig,
    pub(crate) plan: ManeuverPlan,
    pub(crate) matcher: Matcher,
    pub(crate) motion: MotionHistory,
    pub(crate) phase: Phase,
    /// A heading past what is in the way, in place of the route's.
    pub(crate) detour: Option<f64>,
    /// Where he may walk, where somebody watches his way.
    pub(crate) way: Option<FreeWay>,
    /// Index of the next maneuver that is not done yet.
    pub(crate) next: usize,
    pub(crate) memory: Memory,
}

/// Seconds since a time; endless where it never was.
pub(crate) fn since(last: Option<Stamp>, now: Stamp) -> f64 {
    last.map_or(f64::INFINITY, |t| now - t)
}

impl Follower {
    /// A walker who has not begun yet.
    pub(crate) fn new(plan: ManeuverPlan, config: GuideConfig) -> Self {
        Self {
            matcher: Matcher::new(config.matcher),
            config,
            plan,
            motion: MotionHistory::default(),
            phase: Phase::Begin,
            detour: None,
            way: None,
            next: 0,
            memory: Memory::default(),
        }
    }

    /// Replaces the plan by a corrected one: the walker keeps his distance to the end.
    pub(crate) fn replace_plan(&mut self, plan: ManeuverPlan) {
        self.matcher.shift(plan.length() - self.plan.length(), plan.length());
        let along = self.matcher.along_m();
        let done = self.plan.maneuvers().len() - self.next;
        self.plan = plan;
        // As many maneuvers remain as before where that fits the new plan; else those behind the walker are done.
        let behind = self.plan.maneuvers().partition_point(|m| m.at_m < along + 0.3);
        self.next = match self.plan.maneuvers().len().checked_sub(done) {
            Some(k) if k.abs_diff(behind) <= 1 => k,
            _ => behind,
        };
        self.memory.announced_at_m = self.memory.announced_at_m.min(along);
    }

    /// Where a walker is on the route, searched near where he was before.
    pub(crate) fn update_match(&mut self, walker: &Heading, now: Stamp) -> Match {
        self.matcher.update(&self.plan, &walker.position, now)
    }

    /// The walker is told to go: leg start, progress and waiting times start again.
    pub(crate) fn set_out(&mut self, now: &Now) {
        self.phase = Phase::Moving;
        self.memory.announced_at_m = now.at.along_m;
        self.memory.leg_start_m = now.at.along_m;
        self.memory.aim_off_since = None;
        self.memory.last_direction = Some(now.stamp);
        self.memory.set_out = Some(now.stamp);
        self.memory.wrong_m = 0.0;
        self.memory.stopped_said = None;
        // The time spent on a turn does not count as time off the path.
        self.memory.off_since = self.memory.off_since.map(|_| now.stamp);
    }

    pub(crate) fn direction_given(&mut self, now: &Now) {
        self.memory.last_direction = Some(now.stamp);
        self.memory.aim_off_since = None;
    }

    /// What has just been said is no direction to a side: one may follow soon.
    pub(crate) fn correct_soon(&mut self, now: &Now) {
        let rest = self.config.adjust_again_s - self.config.adjust_after_turn_s;
        self.memory.last_direction = Some(now.stamp.plus_seconds(-rest));
    }

    pub(crate) fn turn_on_spot(&mut self, now: &Now) {
        self.direction_given(now);
        self.phase = Phase::Turning(Turning::new(now, true));
    }

    /// The next maneuver, if any.
    pub(crate) fn next_maneuver(&self) -> Option<&Maneuver> {
        self.plan.maneuvers().get(self.next)
    }

    /// Metres along the route of the next thing to do: a maneuver or the end.
    pub(crate) fn next_at_m(&self) -> f64 {
        self.next_maneuver().map_or(self.plan.length(), |m| m.at_m)
    }

    /// The heading towards the look-ahead point on the route, which never lies past the next turn.
    pub(crate) fn aim(&self, now: &Now) -> f64 {
        self.detour.unwrap_or_else(|| self.route_aim(now))
    }

    /// The heading towards the look-ahead point, whatever is in the way.
    pub(crate) fn route_aim(&self, now: &Now) -> f64 {
        if self.stuck_beside_route(now) {
            return heading_of(&(now.at.foot - now.walker.position));
        }
        let s = &self.config;
        let reach = s.look_ahead_m.max(s.look_ahead_s * now.speed).max(2.0 * now.at.cross_m.abs());
        let target = (now.at.along_m + reach).min(self.next_at_m());
        let to = self.plan.point_at(target) - now.walker.position;
        // A point too close to the walker gives no stable heading: there the heading of the route counts, unless the
        // walker stands well beside it.
        let beside_m = if self.backwards() { s.backwards_off_m } else { BESIDE_M };
        let least = match self.next_maneuver() {
            Some(_) if now.at.cross_m.abs() < beside_m => 2.0,
            Some(_) => 0.8,
            None => 0.5,
        };
        if to.norm() < least { self.leg_heading(now) } else { heading_of(&to) }
    }

    /// The corner with several bends in which the walker is, once they were told to turn there.
    pub(crate) fn corner_here(&self, now: &Now) -> Option<&Maneuver> {
        // Backwards, slow and turned exactly, walkers do better by the piece that they are on.
        if self.backwards() {
            return None;
        }
        let told = self.plan.maneuvers().get(self.next.checked_sub(1)?)?;
        (told.at_m..told.end_m).contains(&now.at.along_m).then_some(told)
    }

    /// The heading of the leg that the walker is on: within a corner that of the leg after it, not of the piece between its bends.
    pub(crate) fn leg_heading(&self, now: &Now) -> f64 {
        self.corner_here(now).map_or(now.at.heading, |corner| corner.exit_heading)
    }

    /// Whether a walker may walk on in the heading that he has.
    pub(crate) fn may_set_out(&self, now: &Now) -> bool {
        self.way.as_ref().is_none_or(|way| way.admits(now.walker.course))
    }

    /// Whether who walks may be told to bear by so many radians, positive left.
    pub(crate) fn may_bear(&self, now: &Now, turn_rad: f64) -> bool {
        self.way.as_ref().is_none_or(|way| way.admits_bearing(now.walker.course + turn_rad))
    }

    /// True when the walker is stuck beside the route and is best led straight back to it, because an obstacle lies
    /// between him and the point ahead. Alternates with the point ahead while neither helps.
    pub(crate) fn stuck_beside_route(&self, now: &Now) -> bool {
        let beside = now.at.cross_m.abs() > STUCK_BESIDE_M && !self.backwards();
        beside && self.memory.stuck.is_some_and(|(_, told)| told % 4 >= 2)
    }

    pub(crate) fn backwards(&self) -> bool {
        self.config.facing == Facing::Backwards
    }

    /// What comes next from here.
    pub(crate) fn ahead(&self, now: &Now) -> UpcomingManeuver {
        self.ahead_of(now.at.along_m)
    }

    /// What comes next from so many metres along the route.
    pub(crate) fn ahead_of(&self, along_m: f64) -> UpcomingManeuver {
        let maneuvers = self.plan.maneuvers();
        let Some(m) = maneuvers.get(self.next) else {
            let distance_m = (self.plan.length() - along_m).max(0.0);
            return UpcomingManeuver { distance_m, next: Next::End, then: None };
        };
        let then = maneuvers.get(self.next + 1).filter(|n| n.joined);
        UpcomingManeuver {
            distance_m: (m.at_m - along_m).max(0.0),
            next: as_next(m),
            then: then.map(|n| ((n.at_m - m.end_m).max(0.0), as_next(n))),
        }
    }
}

fn as_next(m: &Maneuver) -> Next {
    match m.stairs {
        Some(s) if m.turn_rad == 0.0 => Next::Stairs(s),
        stairs => Next::Turn { turn_rad: m.turn_rad, stairs },
    }
}
