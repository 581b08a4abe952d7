//! The guide: from stamped poses and a maneuver plan to cues.
//!
//! Input: a camera pose in the odom frame with its tracking confidence, many times a second, and a step with the last
//! pose when there is no new one. Output: at most one cue a step. Its only clock is the stamps, and it has no map: plan and
//! poses are in the odom frame, and when a correction of the map moves the route there, the caller passes the moved plan
//! to [`Guide::correct_route`].
//!
//! A step asks in this order: must the walker stop (`stops.rs`), is he on the route at all, does a correction of the map
//! contradict what he was told (`correction.rs`), and what helps him in what he is doing (`follow`).

use crate::config::GuideConfig;
use crate::correction::Corrections;
use crate::cue::{AT_START_M, Cue, CueKind, First, Step, StopReason, UpcomingManeuver};
use crate::facing::{Facing, Heading};
use crate::follow::{Follower, Now, Phase, Turning};
use crate::free_way::FreeWay;
use crate::ground::{Ground, heading_of};
use crate::input::GuideInput;
use crate::jumps::Jumps;
use crate::maneuvers::ManeuverPlan;
use crate::matcher::Match;
use crate::route::Confidence;
use crate::stops::{Recovery, Stops};
use cairn_geometry::{Se3, Vec2};
use cairn_sensor::{MotionProfile, Stamp};

/// Why guidance cannot begin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum GuideError {
    /// Walking backwards is for flat ground only.
    #[error("the route has stairs: it must not be walked backwards")]
    BackwardsOnStairs,
}

/// What the guide is doing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GuideState {
    /// Waiting for the first good pose.
    Waiting,
    /// The walker turns on the spot.
    Turning,
    /// The walker is moving along the route.
    Moving,
    /// Walking backwards: standing at the end of a leg, looking behind.
    Checking,
    /// Walking backwards: stepping back to the line.
    SteppingAside,
    /// Stopped for a reason.
    Stopped(StopReason),
    /// The end was reached.
    Arrived,
}

/// Guides one walker along one route.
#[derive(Clone, Debug)]
pub struct Guide {
    ground: Ground,
    follower: Follower,
    stops: Stops,
    jumps: Jumps,
    corrections: Corrections,
    /// The walker has been told to move.
    started: bool,
    /// The next first direction follows one that was not heard, not a stop.
    again: bool,
    /// The next first direction follows a stop for something in the way.
    cleared: bool,
    last_match: Option<Match>,
    /// The step that a walker who was stopped is to make, and whether he was told.
    step: Option<(Step, bool)>,
    /// How a step that he was told to make has ended since the last time.
    step_ended: Option<StepEnd>,
    /// Since when tracking has been weak, and whether that was said.
    weak: Option<(Stamp, bool)>,
    /// When a walker who is not on the route was last told where it is.
    away_said: Option<Stamp>,
    /// When the last cue was given.
    cued: Option<Stamp>,
}

/// How a step that a walker was told to make ends.
#[derive(Clone, Copy, Debug, PartialEq)]
enum StepEnd {
    /// It was made, or given up.
    Over,
    /// He went elsewhere.
    Astray,
}

/// Seconds that it takes to say the warning before walking backwards.
const WARNING_S: f64 = 8.0;
/// When starting from standing, a turn this near is the first thing to do, metres.
const RIGHT_AHEAD_M: f64 = 1.0;
/// A walker nearer to the route than this can join it, metres.
const JOIN_REACH_M: f64 = 5.0;
/// Whoever is stopped or waits hears at least a sound at this interval, seconds: with a step of the engine that takes a second, and the
/// way of the sound, still every three.
const QUIET_S: f64 = 2.0;
/// A walker who is farther away is told so at this interval, seconds.
const AWAY_AGAIN_S: f64 = 12.0;

impl Guide {
    /// A guide along `plan`, in the odom frame whose ground plane is `ground`.
    ///
    /// # Errors
    /// [`GuideError::BackwardsOnStairs`] for [`Facing::Backwards`] on a route with stairs.
    pub fn new(plan: ManeuverPlan, ground: Ground, config: GuideConfig) -> Result<Self, GuideError> {
        if config.facing == Facing::Backwards && plan.has_stairs() {
            return Err(GuideError::BackwardsOnStairs);
        }
        Ok(Self {
            ground,
            follower: Follower::new(plan, config),
            stops: Stops::default(),
            jumps: Jumps::default(),
            corrections: Corrections::default(),
            started: false,
            again: false,
            cleared: false,
            last_match: None,
            step: None,
            step_ended: None,
            weak: None,
            away_said: None,
            cued: None,
        })
    }

    /// The present state.
    pub fn state(&self) -> GuideState {
        if let Some(reason) = self.stops.reason() {
            return GuideState::Stopped(reason);
        }
        match &self.follower.phase {
            Phase::Begin => GuideState::Waiting,
            Phase::Turning(_) => GuideState::Turning,
            Phase::Moving => GuideState::Moving,
            Phase::Checking { .. } => GuideState::Checking,
            Phase::SteppingAside { .. } => GuideState::SteppingAside,
            Phase::Done => GuideState::Arrived,
        }
    }

    /// The plan being walked.
    pub fn plan(&self) -> &ManeuverPlan {
        &self.follower.plan
    }

    /// What the walker can do.
    pub fn motion(&self) -> &MotionProfile {
        &self.follower.config.motion
    }

    /// The walker's place on the route at the last good pose.
    pub fn place(&self) -> Option<Match> {
        self.last_match
    }

    /// Replaces the plan by a corrected one after the map was corrected. `moved` is the motion of the route near the
    /// walker, in the odometry frame. The walker keeps his distance to the end.
    pub fn correct_route(&mut self, plan: ManeuverPlan, moved: &Se3, now: Stamp) {
        let is_halted = self.stops.reason().is_some();
        self.stops.route_lengthens(plan.length() - self.follower.plan.length());
        self.corrections.correct(&mut self.follower, &self.ground, plan, moved, now, is_halted);
    }

    /// Replaces the plan when a new segment of odometry has begun, with the ground plane in its frame: the poses before
    /// say nothing about those to come.
    pub fn begin_segment(&mut self, plan: ManeuverPlan, ground: Ground) {
        self.follower.replace_plan(plan);
        self.ground = ground;
        self.corrections.begin_segment();
        self.stops.begin_segment();
        self.jumps = Jumps::default();
        self.follower.motion.clear();
    }

    /// Leads the walker along another heading than the route's, past something in the way: radians on the ground plane.
    /// `None` leads back to the route.
    pub fn detour(&mut self, heading: Option<f64>) {
        self.follower.detour = heading.filter(|h| h.is_finite());
    }

    /// Tells where the walker may be sent, for the next step: he is not told to set out in a heading, or to bear to one, that is
    /// not free. `None` where nobody watches his way.
    pub fn free_way(&mut self, way: Option<FreeWay>) {
        self.follower.way = way;
    }

    /// Where there is no way past what the walker was stopped for from where he stands: the step that he is to make. It is said at once,
    /// and "stop" is not said again while he makes it, which would cut it short. `None` once it has been made.
    pub fn take_step(&mut self, step: Option<Step>) {
        let before = self.step.filter(|(_, told)| *told).map(|(before, _)| before);
        if before.is_some() && step.is_none() {
            self.step_ended = Some(StepEnd::Over);
        }
        self.step = step.map(|step| (step, before == Some(step)));
    }

    /// The walker goes elsewhere than the step leads that he was told to make: he hears "stop" at once.
    pub fn went_astray(&mut self) {
        self.step = None;
        self.step_ended = Some(StepEnd::Astray);
    }

    /// Whether the walker walks, or will without another word when his turn has ended.
    pub fn goes_on(&self) -> bool {
        self.stops.reason().is_none()
            && match &self.follower.phase {
                Phase::Turning(turning) => turning.goes_on(),
                phase => matches!(phase, Phase::Moving),
            }
    }

    /// Metres along the route from the last good pose to the next thing to do: a maneuver or the end. `None` before the first.
    pub fn metres_to_next(&self) -> Option<f64> {
        Some(self.follower.next_at_m() - self.last_match?.along_m)
    }

    /// What comes next on the route from the last good pose. `None` before the first.
    pub fn ahead(&self) -> Option<UpcomingManeuver> {
        let at = self.last_match?;
        Some(self.follower.ahead_of(at.along_m))
    }

    /// Where the walker is led now: the next point of the route to go to, never past the next turn, and metres along the
    /// route to it. `None` before the first good pose.
    pub fn aim_point(&self) -> Option<(f64, Vec2)> {
        let (at, follower) = (self.last_match?, &self.follower);
        let along = (at.along_m + follower.config.look_ahead_m).min(follower.next_at_m());
        Some((along, follower.plan.point_at(along)))
    }

    /// The heading in which a walker at this place would be led along the route, in radians. `None` before the first good pose.
    pub fn route_heading(&self, walker: &Heading, now: Stamp) -> Option<f64> {
        let at = self.last_match?;
        Some(self.follower.route_aim(&Now { stamp: now, walker: *walker, at, speed: 0.0 }))
    }

    /// A cue was dropped before it was said, because its pose had become too old: the next step directs the walker anew.
    pub fn not_heard(&mut self, cue: &CueKind) {
        if matches!(self.follower.phase, Phase::Done) || matches!(cue, CueKind::Progress(_)) {
            return;
        }
        self.again = !matches!(
            cue,
            CueKind::Start { .. }
                | CueKind::Away { .. }
                | CueKind::Resume(_)
                | CueKind::Clear(_)
                | CueKind::Around(_)
        );
        self.cleared = matches!(cue, CueKind::Clear(_) | CueKind::Around(_));
        self.away_said = None;
        self.started &= !matches!(cue, CueKind::Start { .. });
        self.follower.phase = Phase::Begin;
    }

    /// Takes a pose (or the last one again, when time passed without a new one) and returns the cue that is due.
    pub fn step(&mut self, input: &GuideInput) -> Option<Cue> {
        if matches!(self.follower.phase, Phase::Done) {
            return None;
        }
        let kind = self.decide(input).or_else(|| self.still_here(input.now))?;
        self.cued = Some(input.now);
        self.corrections.note(&kind, input.now);
        Some(Cue { stamp: input.now, facing: self.follower.config.facing, kind })
    }

    /// The sign for whoever is stopped or waits, and would hear nothing.
    fn still_here(&mut self, now: Stamp) -> Option<CueKind> {
        let waits = matches!(self.state(), GuideState::Stopped(_) | GuideState::Waiting);
        let since = *self.cued.get_or_insert(now);
        (waits && now - since >= QUIET_S).then_some(CueKind::StillHere)
    }

    fn decide(&mut self, input: &GuideInput) -> Option<CueKind> {
        let moved = self.follower.config.facing.heading(&self.ground, &input.odom_from_camera);
        let stop = self.stops.due(input, moved.as_ref(), &self.follower.config);
        match &moved {
            // After a loss the walker may be anywhere.
            _ if input.confidence == Confidence::Lost => self.jumps = Jumps::default(),
            Some(walker) => self.jumps.step(input.pose_stamp, walker.position),
            None => {}
        }
        let (Some(moved), None) = (moved, stop) else {
            let along_m = self.follower.matcher.along_m();
            let reason = stop.unwrap_or(StopReason::TrackingLost);
            let reason = self.stops.or_given_up(reason, along_m, input.now, self.started);
            return self.halt(reason, input.now);
        };
        if self.jumps.is_doubted() {
            return None;
        }
        if self.jumps.has_landed() {
            self.follower.matcher.search_anywhere();
            self.again = self.started;
            self.follower.phase = Phase::Begin;
        }
        if self.stops.final_at(self.follower.matcher.along_m(), input.now).is_some() {
            // The walker may come on along the route with the help of others.
            let at = self.follower.update_match(&moved, input.now);
            self.last_match = Some(at);
            if let Some(reason) = self.stops.final_at(at.along_m, input.now) {
                return self.halt(reason, input.now);
            }
        }
        if !self.has_recovered(input.now) {
            return None;
        }
        let now = self.locate(input, moved);
        if !self.started && (now.at.foot - now.walker.position).norm() > JOIN_REACH_M {
            return self.away(&now);
        }
        // What leads him past something in the way leads him aside and back.
        if self.started && self.follower.detour.is_none() {
            self.stops.led(input.now, now.at.along_m, now.walker.position);
        }
        if let Some(kind) = self.weak(input).or_else(|| self.corrections.cue(&mut self.follower, &now)) {
            return Some(kind);
        }
        match self.follower.phase {
            Phase::Begin => Some(self.begin(&now)),
            _ => self.follower.step(&now),
        }
    }

    /// Where the walker is on the route, from a good pose with his heading there.
    fn locate(&mut self, input: &GuideInput, moved: Heading) -> Now {
        // The walker's motion is that of the odometry: a correction that is being eased in is none.
        let follower = &mut self.follower;
        follower.motion.push(input.pose_stamp, &moved);
        self.corrections.take(input.odom_from_camera);
        let eased =
            self.corrections.eased(&follower.config, &self.ground, &input.odom_from_camera, input.now);
        let walker = eased.unwrap_or(moved);
        let at = match self.started {
            false => follower.matcher.join(&follower.plan, &walker.position, AT_START_M),
            true => follower.update_match(&walker, input.now),
        };
        self.last_match = Some(at);
        let speed = input.speed.filter(|v| v.is_finite()).unwrap_or_else(|| follower.motion.speed());
        Now { stamp: input.now, walker, at, speed }
    }

    /// The walker is not on the route: says where it is, and waits.
    fn away(&mut self, now: &Now) -> Option<CueKind> {
        if self.away_said.is_some_and(|said| now.stamp - said < AWAY_AGAIN_S) {
            return None;
        }
        self.away_said = Some(now.stamp);
        let to_route = now.at.foot - now.walker.position;
        let bearing_rad = now.walker.turn_to(heading_of(&to_route));
        Some(CueKind::Away { distance_m: to_route.norm(), bearing_rad })
    }

    fn halt(&mut self, reason: StopReason, now: Stamp) -> Option<CueKind> {
        match self.step_ended.take() {
            Some(StepEnd::Over) => self.stops.told_to_step(now),
            Some(StepEnd::Astray) => self.stops.say_again(),
            None => {}
        }
        let turn_rate = self.follower.motion.turn_rate();
        let kind = self.stops.halt(reason, now, &self.follower.config, turn_rate, self.started);
        let step = self.step.filter(|_| reason.is_in_the_way());
        let Some((step, _)) = step.filter(|(_, told)| self.stops.may_step(*told, now)) else {
            // Not while he makes a step: it would be cut short.
            let kind = kind.filter(|_| step.is_none_or(|(_, told)| !told));
            if kind.is_some() {
                self.stops.spoke(now);
            }
            return kind;
        };
        self.step = Some((step, true));
        self.stops.told_to_step(now);
        Some(CueKind::Step(step))
    }

    /// True when guidance may go on.
    fn has_recovered(&mut self, now: Stamp) -> bool {
        match self.stops.recover(now, &self.follower.config) {
            Recovery::Free => true,
            Recovery::Waiting => false,
            Recovery::Ends { in_the_way } => {
                (self.cleared, self.again) = (in_the_way, false);
                self.follower.matcher.search_if_far();
                self.follower.motion.clear();
                self.corrections.clear();
                self.follower.phase = Phase::Begin;
                true
            }
        }
    }

    fn weak(&mut self, input: &GuideInput) -> Option<CueKind> {
        if input.confidence == Confidence::Good {
            self.weak = None;
            return None;
        }
        let (since, said) = self.weak.get_or_insert((input.now, false));
        let due = self.started && !*said && input.now - *since >= self.follower.config.weak_s;
        *said |= due;
        due.then_some(CueKind::Weak)
    }

    /// The first cue, and the first one after a stop.
    fn begin(&mut self, now: &Now) -> CueKind {
        let follower = &mut self.follower;
        // A turn directly ahead is made at once.
        let along = now.at.along_m;
        follower.next = follower
            .plan
            .maneuvers()
            .partition_point(|m| m.end_m < along + 0.3 || m.at_m < along + RIGHT_AHEAD_M);
        let at = match self.started {
            true => follower.past_corner(now),
            false => now.at,
        };
        self.last_match = Some(at);
        let now = &Now { at, ..*now };
        // Stopped where the route ends.
        if self.started
            && let Some(arrived) = follower.arrival(now)
        {
            return arrived;
        }
        let turn = now.walker.turn_to(follower.aim(now));
        let tolerance_deg = match follower.detour {
            Some(_) => follower.config.detour_tolerance_deg,
            None => follower.config.turn_tolerance_deg,
        };
        let first = if turn.abs().to_degrees() < tolerance_deg && follower.may_set_out(now) {
            follower.set_out(now);
            First::Go(follower.ahead(now))
        } else {
            follower.phase = Phase::Turning(Turning::new(now, false));
            First::Turn(follower.worded(turn))
        };
        follower.memory.last_direction = Some(now.stamp);
        // The first text for walking backwards is long: it contains a warning.
        if !self.started && follower.backwards() {
            follower.memory.set_out = Some(now.stamp.plus_seconds(WARNING_S));
        }
        let again = std::mem::take(&mut self.again);
        if std::mem::take(&mut self.cleared) && self.started {
            return if follower.detour.is_some() { CueKind::Around(first) } else { CueKind::Clear(first) };
        }
        match (std::mem::replace(&mut self.started, true), again, first) {
            (false, ..) => {
                let total_m = follower.plan.length();
                CueKind::Start { total_m, left_m: (total_m - along).max(0.0), first }
            }
            (true, false, _) => CueKind::Resume(first),
            (true, true, First::Turn(turn)) => CueKind::Rotate(turn),
            (true, true, First::Go(ahead)) => CueKind::Go { ahead, check: false },
        }
    }
}
