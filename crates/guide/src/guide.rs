//! The guide: from stamped poses and a maneuver plan to cues.
//!
//! Input: a camera pose in the odom frame with its tracking confidence, many times a second, and a step with the last
//! pose when there is no new one. Output: at most one cue a step. Its only clock is the stamps, and it has no map: plan and
//! poses are in the odom frame, and when a correction of the map moves the route there, the caller passes the moved plan
//! to [`Guide::correct_route`].

use crate::blind::Blind;
use crate::config::GuideConfig;
use crate::correction::{Easing, Told};
use crate::cue::{Ahead, Cue, CueKind, First, Next, StopReason};
use crate::facing::{Facing, Heading};
use crate::ground::{Ground, heading_of};
use crate::losses::Losses;
use crate::maneuvers::{Maneuver, ManeuverPlan};
use crate::matcher::{Match, Matcher};
use crate::motion::Motion;
use crate::route::Confidence;
use crate::runaway::Runaway;
use crate::turning::Turning;
use cairn_geometry::{Camera, Odom, Pose, Vec2};
use cairn_sensor::Stamp;

/// The input of one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GuideInput {
    /// The time now, in the clock of the poses.
    pub now: Stamp,
    /// The time of the pose.
    pub pose_stamp: Stamp,
    /// Pose of the camera (x right, y down, z forward) in the odom frame; the last known one when tracking is lost.
    pub odom_from_camera: Pose<Odom, Camera>,
    /// Tracking confidence of the pose.
    pub confidence: Confidence,
    /// Speed over ground in m/s, where a better source than the poses measures it.
    pub speed: Option<f64>,
    /// A reason to stop that another component reports: an obstacle, unknown ground, a failed stage.
    pub hazard: Option<StopReason>,
}

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

#[derive(Clone, Debug)]
pub(crate) enum Phase {
    Begin,
    Turning(Turning),
    Moving,
    Checking { since: Stamp },
    SteppingAside { since: Stamp },
    Done,
}

/// The state derived from one step's input.
pub(crate) struct Now {
    pub stamp: Stamp,
    pub walker: Heading,
    pub at: Match,
    pub speed: f64,
}

/// Guides one walker along one route.
#[derive(Clone, Debug)]
pub struct Guide {
    pub(crate) config: GuideConfig,
    pub(crate) ground: Ground,
    pub(crate) plan: ManeuverPlan,
    pub(crate) matcher: Matcher,
    pub(crate) motion: Motion,
    pub(crate) phase: Phase,
    halted: Option<Halt>,
    losses: Losses,
    blind: Blind,
    pub(crate) runaway: Runaway,
    /// Since when the first pose is waited for.
    waiting_since: Option<Stamp>,
    started: bool,
    /// The next first direction follows one that was not heard, not a stop.
    again: bool,
    /// The next first direction follows a stop for something in the way.
    cleared: bool,
    /// A heading past what is in the way, in place of the route's.
    detour: Option<f64>,
    last_match: Option<Match>,
    /// Index of the next maneuver that is not done yet.
    pub(crate) next: usize,
    pub(crate) memory: Memory,
    /// The last good pose.
    pub(crate) pose: Option<Pose<Odom, Camera>>,
    pub(crate) easing: Option<Easing>,
    pub(crate) told: Told,
    /// A correction contradicts what was told, and the walker does not know yet.
    pub(crate) correction_due: bool,
}

/// How many times "stop" is said while tracking is lost before the walker is asked to look round.
const STOPS_BEFORE_LOOK_ROUND: u32 = 4;
/// Seconds for which the first pose is waited for in silence.
const SILENT_S: f64 = 10.0;
/// Seconds that it takes to say the warning before walking backwards.
const WARNING_S: f64 = 8.0;
/// When starting from standing, a turn this near is the first thing to do, metres.
const RIGHT_AHEAD_M: f64 = 1.0;
/// Within this distance of the start of a route the walker is at its start, metres.
pub(crate) const AT_START_M: f64 = 3.0;
/// A walker nearer to the route than this can join it, metres.
const JOIN_REACH_M: f64 = 5.0;
/// A walker who is farther away is told so at this interval, seconds.
const AWAY_AGAIN_S: f64 = 12.0;
/// Angle of each turn that a lost walker is asked for, radians.
const LOOK_ROUND_RAD: f64 = 0.7;

#[derive(Clone, Copy, Debug)]
struct Halt {
    reason: StopReason,
    said: Stamp,
    /// How many times it was said.
    times: u32,
    good_since: Option<Stamp>,
}

/// What the guide remembers between steps: mostly when something was last said or observed.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    /// The maneuver whose approach was announced.
    pub approached: Option<usize>,
    /// The end was announced.
    pub end_announced: bool,
    /// When the last direction was given.
    pub last_direction: Option<Stamp>,
    /// Metres along the route when the distance ahead was last announced.
    pub announced_at_m: f64,
    /// When the walker was last told to go on; moved later by the duration of long texts.
    pub set_out: Option<Stamp>,
    pub aim_off_since: Option<Stamp>,
    pub off_since: Option<Stamp>,
    pub off: bool,
    pub off_said: Option<Stamp>,
    pub wrong_m: f64,
    pub wrong_said: Option<Stamp>,
    pub stopped_said: Option<(Stamp, u32)>,
    /// Metres along the route where the walker is stuck beside it, and how many times directions were given there.
    pub stuck: Option<(f64, u32)>,
    /// How many times the walker missed the end.
    pub ends_missed: u32,
    pub ticked: Option<Stamp>,
    pub leg_start_m: f64,
    pub fast_since: Option<Stamp>,
    pub fast_said: Option<Stamp>,
    pub weak_since: Option<Stamp>,
    pub weak_said: bool,
    /// When a walker who is not on the route was last told where it is.
    pub away_said: Option<Stamp>,
}

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
            matcher: Matcher::new(config.matcher),
            config,
            ground,
            plan,
            motion: Motion::default(),
            phase: Phase::Begin,
            halted: None,
            losses: Losses::default(),
            blind: Blind::default(),
            runaway: Runaway::default(),
            waiting_since: None,
            started: false,
            again: false,
            cleared: false,
            detour: None,
            last_match: None,
            next: 0,
            memory: Memory::default(),
            pose: None,
            easing: None,
            told: Told::default(),
            correction_due: false,
        })
    }

    /// The present state.
    pub fn state(&self) -> GuideState {
        match (&self.halted, &self.phase) {
            (Some(halt), _) => GuideState::Stopped(halt.reason),
            (_, Phase::Begin) => GuideState::Waiting,
            (_, Phase::Turning(_)) => GuideState::Turning,
            (_, Phase::Moving) => GuideState::Moving,
            (_, Phase::Checking { .. }) => GuideState::Checking,
            (_, Phase::SteppingAside { .. }) => GuideState::SteppingAside,
            (_, Phase::Done) => GuideState::Arrived,
        }
    }

    /// The plan being walked.
    pub fn plan(&self) -> &ManeuverPlan {
        &self.plan
    }

    /// The walker's place on the route at the last good pose.
    pub fn place(&self) -> Option<Match> {
        self.last_match
    }

    /// Replaces the plan by a corrected one: the walker keeps his distance to the end.
    pub(crate) fn replace_plan(&mut self, plan: ManeuverPlan) {
        let left = self.plan.length() - self.matcher.along_m();
        let along = (plan.length() - left).clamp(0.0, plan.length());
        let done = self.plan.maneuvers().len() - self.next;
        self.plan = plan;
        self.matcher.place(along);
        // As many maneuvers remain as before where that fits the new plan; else those behind the walker are done.
        let behind = self.plan.maneuvers().partition_point(|m| m.at_m < along + 0.3);
        self.next = match self.plan.maneuvers().len().checked_sub(done) {
            Some(k) if k.abs_diff(behind) <= 1 => k,
            _ => behind,
        };
        self.memory.announced_at_m = self.memory.announced_at_m.min(along);
    }

    /// Leads the walker along another heading than the route's, past something in the way: radians on the ground plane.
    /// `None` leads back to the route.
    pub fn detour(&mut self, heading: Option<f64>) {
        self.detour = heading.filter(|h| h.is_finite());
    }

    /// The heading of a detour under way, in radians.
    pub fn detour_heading(&self) -> Option<f64> {
        self.detour
    }

    /// Where the walker is led now: the next point of the route to go to, never past the next turn, and metres along the
    /// route to it. `None` before the first good pose.
    pub fn aim_point(&self) -> Option<(f64, Vec2)> {
        let at = self.last_match?;
        let along = (at.along_m + self.config.look_ahead_m).min(self.next_at_m());
        Some((along, self.plan.point_at(along)))
    }

    /// A cue was dropped before it was said, because its pose had become too old: the next step directs the walker anew.
    pub fn not_heard(&mut self, cue: &CueKind) {
        if matches!(self.phase, Phase::Done) || matches!(cue, CueKind::Progress(_)) {
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
        self.memory.away_said = None;
        self.started &= !matches!(cue, CueKind::Start { .. });
        self.phase = Phase::Begin;
    }

    /// Takes a pose (or the last one again, when time passed without a new one) and returns the cue that is due.
    pub fn step(&mut self, input: &GuideInput) -> Option<Cue> {
        if matches!(self.phase, Phase::Done) {
            return None;
        }
        let kind = self.decide(input)?;
        self.told.note(&kind, input.now);
        Some(Cue { stamp: input.now, facing: self.config.facing, kind })
    }

    fn decide(&mut self, input: &GuideInput) -> Option<CueKind> {
        let moved = self.heading(&input.odom_from_camera);
        let stop = self.stop_reason(input, moved.as_ref());
        let (Some(moved), None) = (moved, stop) else {
            let reason = stop.unwrap_or(StopReason::TrackingLost);
            let reason = self.or_given_up(reason, input.now);
            return self.halt(reason, input.now);
        };
        if self.losses.are_final_at(self.matcher.along_m()) {
            // The walker may come on along the route with the help of others.
            let at = self.matcher.update(&self.plan, &moved.position, input.now);
            self.last_match = Some(at);
            if self.losses.are_final_at(at.along_m) {
                return self.halt(StopReason::CannotRelocalise, input.now);
            }
        }
        if !self.has_recovered(input.now) {
            return None;
        }
        // The walker's motion is that of the odometry: a correction that is being eased in is none.
        self.motion.push(input.pose_stamp, &moved);
        self.pose = Some(input.odom_from_camera);
        let walker = self.eased(&input.odom_from_camera, input.now).unwrap_or(moved);
        let joins = !self.started;
        let at = match joins {
            true => self.matcher.join(&self.plan, &walker.position, AT_START_M),
            false => self.matcher.update(&self.plan, &walker.position, input.now),
        };
        self.last_match = Some(at);
        let speed = input.speed.filter(|v| v.is_finite()).unwrap_or_else(|| self.motion.speed());
        let now = Now { stamp: input.now, walker, at, speed };
        if joins && (at.foot - now.walker.position).norm() > JOIN_REACH_M {
            return self.away(&now);
        }
        if let Some(kind) = self.weak(input).or_else(|| self.corrected(&now)) {
            return Some(kind);
        }
        match self.phase.clone() {
            Phase::Begin => Some(self.begin(&now)),
            Phase::Turning(turning) => self.turning(turning, &now),
            Phase::Moving => self.moving(&now),
            Phase::Checking { since } => self.checking(since, &now),
            Phase::SteppingAside { since } => self.stepping_aside(since, &now),
            Phase::Done => None,
        }
    }

    /// The walker's position and heading at a pose of the camera.
    pub(crate) fn heading(&self, odom_from_camera: &Pose<Odom, Camera>) -> Option<Heading> {
        self.config.facing.heading(&self.ground, odom_from_camera)
    }

    /// The walker is not on the route: says where it is, and waits.
    fn away(&mut self, now: &Now) -> Option<CueKind> {
        if self.memory.away_said.is_some_and(|said| now.stamp - said < AWAY_AGAIN_S) {
            return None;
        }
        self.memory.away_said = Some(now.stamp);
        let to_route = now.at.foot - now.walker.position;
        let bearing_rad = now.walker.turn_to(heading_of(&to_route));
        Some(CueKind::Away { distance_m: to_route.norm(), bearing_rad })
    }

    pub(crate) fn is_halted(&self) -> bool {
        self.halted.is_some()
    }

    fn stop_reason(&mut self, input: &GuideInput, walker: Option<&Heading>) -> Option<StopReason> {
        let blind_s = walker.map_or(0.0, |w| self.blind.step(input.confidence, input.pose_stamp, w.heading));
        if input.confidence == Confidence::Lost {
            self.runaway = Runaway::default();
        }
        let runs_away = walker.is_some_and(|w| self.runaway.step(input.pose_stamp, w.position));
        if input.hazard.is_some() {
            input.hazard
        } else if input.confidence == Confidence::Lost {
            Some(StopReason::TrackingLost)
        } else if input.now - input.pose_stamp > self.config.stale_s {
            Some(StopReason::PoseStale)
        } else if self.started && (blind_s > self.config.blind_s || runs_away) {
            Some(StopReason::TrackingLost)
        } else {
            None
        }
    }

    /// Counts a loss of tracking that begins now; where it is one too many, or lasts too long, that is the reason.
    fn or_given_up(&mut self, reason: StopReason, now: Stamp) -> StopReason {
        if reason != StopReason::TrackingLost || !self.started {
            return reason;
        }
        if self.halted.is_none() {
            self.losses.begin(self.matcher.along_m(), now);
        }
        if self.losses.are_final(now) { StopReason::CannotRelocalise } else { reason }
    }

    /// Says stop at once, and again while the reason lasts.
    fn halt(&mut self, reason: StopReason, now: Stamp) -> Option<CueKind> {
        if !self.started && self.halted.is_none() && reason == StopReason::TrackingLost {
            // The walker was not told to move yet: wait for the first pose in silence, but not for long.
            let since = *self.waiting_since.get_or_insert(now);
            if now - since < SILENT_S {
                return None;
            }
        }
        let before = self.halted.filter(|h| h.reason.is_like(&reason)).map(|h| (h.said, h.times));
        // Advice is two sentences and a turn of the body: it takes a while to say and to follow.
        let again_s = match reason {
            StopReason::ScaleUncertain | StopReason::CannotRelocalise => self.config.advice_again_s,
            _ => self.config.stop_again_s,
        };
        let (said, times) = match before {
            Some((said, times)) if now - said < again_s => (said, times),
            Some((_, times)) => (now, times + 1),
            None => (now, 1),
        };
        let due = before.is_none_or(|(_, n)| n != times);
        self.halted = Some(Halt { reason, said, times, good_since: None });
        // Waiting does not recover tracking; mapped views do. They lie on the side that the walker turned from.
        if reason == StopReason::TrackingLost && times > STOPS_BEFORE_LOOK_ROUND {
            let back = if self.motion.turn_rate() > 0.0 { -1.0 } else { 1.0 };
            // Only every second time, so that a "stop" does not cut the turn short.
            return (due && times % 2 == 0).then_some(CueKind::LookRound(back * LOOK_ROUND_RAD));
        }
        due.then_some(CueKind::Stop(reason))
    }

    /// True when guidance may go on; after a stop only once poses have been good for a while.
    fn has_recovered(&mut self, now: Stamp) -> bool {
        let Some(halt) = &mut self.halted else { return true };
        let since = *halt.good_since.get_or_insert(now);
        if now - since < self.config.resume_s {
            return false;
        }
        self.cleared = halt.reason.is_in_the_way();
        self.halted = None;
        self.losses.resume(now);
        self.again = false;
        self.motion.clear();
        // The words that follow tell the whole direction anew.
        (self.easing, self.correction_due, self.told) = (None, false, Told::default());
        self.phase = Phase::Begin;
        true
    }

    fn weak(&mut self, input: &GuideInput) -> Option<CueKind> {
        if input.confidence == Confidence::Good {
            self.memory.weak_since = None;
            self.memory.weak_said = false;
            return None;
        }
        let since = *self.memory.weak_since.get_or_insert(input.now);
        let due = self.started && !self.memory.weak_said && input.now - since >= self.config.weak_s;
        self.memory.weak_said |= due;
        due.then_some(CueKind::Weak)
    }

    /// The first cue, and the first one after a stop.
    fn begin(&mut self, now: &Now) -> CueKind {
        // A turn directly ahead is made at once.
        let along = now.at.along_m;
        self.next = self
            .plan
            .maneuvers()
            .partition_point(|m| m.end_m < along + 0.3 || m.at_m < along + RIGHT_AHEAD_M);
        let turn = now.walker.turn_to(self.aim(now));
        let tolerance_deg = match self.detour {
            Some(_) => self.config.detour_tolerance_deg,
            None => self.config.turn_tolerance_deg,
        };
        let first = if turn.abs().to_degrees() < tolerance_deg {
            self.set_out(now);
            First::Go(self.ahead(now))
        } else {
            self.phase = Phase::Turning(Turning::new(now, false));
            First::Turn(turn)
        };
        self.memory.last_direction = Some(now.stamp);
        // The first text for walking backwards is long: it contains a warning.
        if !self.started && self.backwards() {
            self.memory.set_out = Some(now.stamp.plus_seconds(WARNING_S));
        }
        let again = std::mem::take(&mut self.again);
        if std::mem::take(&mut self.cleared) && self.started {
            return if self.detour.is_some() { CueKind::Around(first) } else { CueKind::Clear(first) };
        }
        match (std::mem::replace(&mut self.started, true), again, first) {
            (false, ..) => {
                let total_m = self.plan.length();
                CueKind::Start { total_m, left_m: (total_m - along).max(0.0), first }
            }
            (true, false, _) => CueKind::Resume(first),
            (true, true, First::Turn(turn)) => CueKind::Rotate(turn),
            (true, true, First::Go(ahead)) => CueKind::Go { ahead, check: false },
        }
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
        if let Some(heading) = self.detour {
            return heading;
        }
        if self.stuck_beside_route(now) {
            return heading_of(&(now.at.foot - now.walker.position));
        }
        let s = &self.config;
        let reach = s.look_ahead_m.max(s.look_ahead_s * now.speed).max(2.0 * now.at.cross_m.abs());
        let target = (now.at.along_m + reach).min(self.next_at_m());
        let to = self.plan.point_at(target) - now.walker.position;
        // A point too close to the walker gives no stable heading: there the heading of the route counts, unless the
        // walker stands well beside it.
        let least = match self.next_maneuver() {
            Some(_) if now.at.cross_m.abs() < 1.0 => 2.0,
            Some(_) => 0.8,
            None => 0.5,
        };
        if to.norm() < least { now.at.heading } else { heading_of(&to) }
    }

    /// What comes next from here.
    pub(crate) fn ahead(&self, now: &Now) -> Ahead {
        let maneuvers = self.plan.maneuvers();
        let Some(m) = maneuvers.get(self.next) else {
            let distance_m = (self.plan.length() - now.at.along_m).max(0.0);
            return Ahead { distance_m, next: Next::End, then: None };
        };
        let then = maneuvers.get(self.next + 1).filter(|n| n.joined);
        Ahead {
            distance_m: (m.at_m - now.at.along_m).max(0.0),
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
