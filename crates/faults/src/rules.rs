//! The rules that never break, checked at every event of a walk, and what each of them needs to remember.

use crate::estimator::{Reading, View};
use crate::scenario::Shape;
use cairn_guide::{Facing, GuideState, Match, Side, StopReason, wrap};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use cairn_session::Said;
use cairn_trial::direction_of;
use cairn_trial::walk::{RouteTruth, Sent};
use std::collections::VecDeque;
use std::f64::consts::PI;

/// No direction comes from an older pose, seconds.
const POSE_S: f64 = 0.5;
/// Whoever is stopped or waits hears something at this interval; over a network a little later, seconds.
const SILENT_S: f64 = 3.0;
const ON_THE_WAY_S: f64 = 0.6;
/// Whoever is said to have arrived stands within this of the true end, metres.
const ARRIVED_M: f64 = 1.5;
/// A direction to the other side within this time is a contradiction where the walker has neither turned nor gone, seconds, radians and
/// metres.
const CONTRADICTION_S: f64 = 3.0;
const TURNED_RAD: f64 = 0.17;
const GONE_M: f64 = 0.5;
/// Both sides lead to what lies behind, radians.
const BEHIND_RAD: f64 = 2.6;
/// Nobody who was stopped is stopped anew sooner, seconds. Times of pictures count, which a network shifts by a little.
const STOP_AND_GO_S: f64 = 1.0;
const SHIFTED_S: f64 = 0.3;
/// After so long without the map in view nobody who walks is sent on, nor by a pose that runs away, seconds.
const BLIND_S: f64 = 3.0;
const RUNAWAY_S: f64 = 1.5;
/// Guidance that was begun anew has to see this for itself, seconds.
const NEW_S: f64 = 6.0;
/// After a pose that was wrong without saying so, words are not judged by the truth for this long, seconds.
const FORGIVEN_S: f64 = 4.0;
/// A step to a side, and as far as which steps lead to the route, metres.
const STEP_M: f64 = 0.3;
const BESIDE_M: f64 = 3.0;
/// When nothing fails any more, guidance or a clear refusal comes within this time, seconds.
const LIVE_S: f64 = 10.0;

/// A rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// No direction comes from a pose that is older than half a second, when it is sent and when it is heard.
    FreshPose,
    /// No direction leads away from the route or to its wrong side.
    RightSide,
    /// Nobody who walks without the map in view is sent on for long.
    SeesTheMap,
    /// Nobody is sent on by a pose that moves faster than anyone walks.
    NoRunaway,
    /// "Arrived" is said within 1.5 m of the true end alone.
    ArrivesAtTheEnd,
    /// Nobody who is lost, stopped or waits hears nothing for more than 3 s.
    NotSilent,
    /// No metres are said while the unit of length is not the metre.
    NoFalseMetres,
    /// No sentence begins while another is being said, unless it breaks it off.
    OneVoice,
    /// No direction contradicts the one before.
    NoContradiction,
    /// Nobody is stopped more than once a second.
    NoStopAndGo,
    /// Nobody who is stopped, or has paused guidance, is given directions.
    StoppedIsStopped,
    /// When nothing fails any more, guidance or a clear refusal comes within 10 s.
    GoesOn,
    /// What was said to be saved is there after a power cut.
    KeepsRoutes,
}

/// A rule that was broken.
#[derive(Clone, Debug, PartialEq)]
pub struct Violation {
    /// Seconds since the walk began.
    pub t_s: f64,
    /// Which.
    pub rule: Rule,
    /// How.
    pub how: String,
}

/// A direction that was said.
#[derive(Clone, Copy)]
struct Directed {
    at: Stamp,
    side: Side,
    walker: (f64, f64, f64),
    turn_rad: f64,
}

/// What the server shows after an event.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    /// `None` where nobody is guided, or guidance is paused.
    pub state: Option<GuideState>,
    pub is_paused: bool,
    pub has_arrived: bool,
    pub walker: (f64, f64, f64),
    /// The session's clock.
    pub clock: Stamp,
}

/// Watches a walk.
pub(crate) struct Rules {
    truth: RouteTruth,
    language: Language,
    backwards: bool,
    over_network: bool,
    calm: Stamp,
    readings: VecDeque<Reading>,
    /// When a pose was last wrong without saying so, and when the map was last corrected.
    lied: Option<Stamp>,
    voice_until: Stamp,
    directed: Option<Directed>,
    /// When guidance was begun anew: it does not know what the poses before were.
    commanded: Stamp,
    state: Option<GuideState>,
    is_paused: bool,
    stopped: Option<Stamp>,
    /// Until when something was heard; since when the walker waits.
    heard: Stamp,
    waits: Option<Stamp>,
    arrived: Option<(Stamp, f64)>,
    lived: bool,
    violations: Vec<Violation>,
}

impl Rules {
    /// On a route; nothing fails from `calm` on.
    pub fn new(truth: RouteTruth, shape: &Shape, over_network: bool, calm: Stamp) -> Self {
        let never = Stamp(i64::MIN / 2);
        Self {
            truth,
            language: shape.language,
            backwards: shape.facing == Facing::Backwards,
            over_network,
            calm,
            readings: VecDeque::new(),
            lied: None,
            voice_until: never,
            directed: None,
            commanded: never,
            state: None,
            is_paused: false,
            stopped: None,
            heard: never,
            waits: None,
            arrived: None,
            lived: false,
            violations: Vec::new(),
        }
    }

    fn broken(&mut self, rule: Rule, now: Stamp, how: String) {
        let is_new = self.violations.last().is_none_or(|v| v.rule != rule || now.seconds() - v.t_s > 1.0);
        if is_new {
            self.violations.push(Violation { t_s: now.seconds(), rule, how });
        }
    }

    /// A picture is taken.
    pub fn pictured(&mut self, reading: &Reading) {
        self.truth.see(reading.walker, reading.stamp);
        if reading.is_false {
            self.lied = Some(reading.stamp);
        }
        self.readings.push_back(*reading);
        if self.readings.len() > 120 {
            self.readings.pop_front();
        }
    }

    fn reading(&self, stamp: Stamp) -> Option<Reading> {
        self.readings.iter().rev().find(|r| r.stamp == stamp).copied()
    }

    fn is_forgiven(&self, now: Stamp) -> bool {
        self.lied.is_some_and(|lied| now - lied < FORGIVEN_S)
    }

    /// The server says this now; `walker` is where they truly are.
    pub fn said(&mut self, said: &Said, walker: (f64, f64, f64), place_m: Option<f64>, now: Stamp) {
        if said.stamp < self.voice_until && !said.interrupts {
            self.broken(Rule::OneVoice, now, said.text.clone());
        }
        self.voice_until = said.stamp.plus_seconds(said.duration_s);
        let reading = said.pose.and_then(|pose| self.reading(pose));
        let newest = self.readings.back().copied();
        if let Some(shown) = reading.or(newest).filter(|_| says_metres(&said.text, self.language)) {
            // A loss says nothing of the unit; nor does what was asked for before.
            let metric = !matches!(shown.view, View::Pose(pose) if !pose.metric);
            if !metric && said.pose.is_some() {
                self.broken(Rule::NoFalseMetres, now, said.text.clone());
            }
        }
        let Some(pose) = said.pose else { return };
        if now - pose > POSE_S + 1e-6 {
            self.broken(Rule::FreshPose, now, format!("sent {:.2} s old: {}", now - pose, said.text));
        }
        let is_stopped = matches!(self.state, Some(GuideState::Stopped(reason)) if !reason.is_in_the_way());
        if is_stopped || self.is_paused {
            self.broken(Rule::StoppedIsStopped, now, said.text.clone());
        }
        if let Some(reading) = reading {
            self.directed(said, &reading, walker, place_m, now);
        }
    }

    fn directed(
        &mut self,
        said: &Said,
        reading: &Reading,
        walker: (f64, f64, f64),
        place_m: Option<f64>,
        now: Stamp,
    ) {
        let is_new = now - self.commanded < NEW_S;
        if reading.blind_s > BLIND_S && !is_new && !self.is_forgiven(now) {
            let how = format!("{:.1} s without the map: {}", reading.blind_s, said.text);
            self.broken(Rule::SeesTheMap, now, how);
        }
        if reading.runaway_s > RUNAWAY_S && !is_new {
            self.broken(Rule::NoRunaway, now, format!("{:.1} s: {}", reading.runaway_s, said.text));
        }
        let Some((side, steps)) = direction_of(&said.text, self.language) else { return };
        let sent = if steps { Sent::Aside } else { Sent::RoundOrAlong };
        let wrong = |at| self.truth.is_wrong(side, sent, at, place_m);
        let may_be_right = if steps { !self.is_sure(reading) } else { self.leads_to_foot(side, walker) };
        if wrong(reading.walker) && wrong(walker) && !may_be_right && !self.is_forgiven(now) {
            let turns =
                [reading.walker, walker].map(|at| self.truth.turns(at).map(|a| a.to_degrees().round()));
            self.broken(Rule::RightSide, now, format!("{} {turns:?} deg lead there", said.text));
        }
        if steps {
            self.directed = None;
            return;
        }
        let turn_rad = said.turn_rad.unwrap_or(0.0);
        let contradicts = self.directed.is_some_and(|before| {
            let turned = wrap(reading.walker.2 - before.walker.2).abs();
            let gone = (reading.walker.0 - before.walker.0).hypot(reading.walker.1 - before.walker.1);
            let is_clear = turn_rad.abs() < BEHIND_RAD && before.turn_rad.abs() < BEHIND_RAD;
            side != before.side
                && now - before.at < CONTRADICTION_S
                && turned < TURNED_RAD
                && gone < GONE_M
                && is_clear
        });
        // A corner turns to its own side, whatever correction came before it.
        let is_corner = !self.truth.is_wrong(side, Sent::Round, reading.walker, place_m);
        if contradicts && !is_corner && !self.is_forgiven(now) {
            self.broken(Rule::NoContradiction, now, said.text.clone());
        }
        self.directed = Some(Directed { at: now, side, walker: reading.walker, turn_rad });
    }

    /// Whether a step to a side can be judged: by a pose that is right to less than a step, beside the route.
    fn is_sure(&self, reading: &Reading) -> bool {
        reading.error_m < STEP_M && self.truth.place().is_some_and(|at| at.cross_m.abs() < BESIDE_M)
    }

    /// Whether a turn to a side leads straight back to the route, from well beside it.
    fn leads_to_foot(&self, side: Side, (x, y, heading): (f64, f64, f64)) -> bool {
        let Some(at) = self.truth.place().filter(|at| at.cross_m.abs() > STEP_M) else { return false };
        let course = if self.backwards { heading + PI } else { heading };
        let turn = wrap((at.foot.y - y).atan2(at.foot.x - x) - course);
        Side::of(turn) == side && turn.abs() > TURNED_RAD
    }

    /// The guide is told anew what to do: what it said before says nothing.
    pub fn commanded(&mut self, now: Stamp) {
        self.commanded = now;
        (self.stopped, self.directed) = (None, None);
    }

    /// What the server shows after an event.
    pub fn server(&mut self, moment: &Moment, now: Stamp) {
        let is_stopped = |state: Option<GuideState>| matches!(state, Some(GuideState::Stopped(_)));
        if is_stopped(moment.state) && !is_stopped(self.state) {
            let clock = moment.clock;
            let least_s = STOP_AND_GO_S - if self.over_network { SHIFTED_S } else { 0.01 };
            if let Some(before) = self.stopped.filter(|before| clock - *before < least_s) {
                self.broken(Rule::NoStopAndGo, now, format!("stopped again after {:.2} s", clock - before));
            }
            self.stopped = Some(clock);
            self.directed = None;
        }
        (self.state, self.is_paused) = (moment.state, moment.is_paused);
        if moment.has_arrived && self.arrived.is_none() {
            self.arrived = Some((now, self.truth.from_end_m(moment.walker)));
        }
        let waits = matches!(moment.state, Some(GuideState::Stopped(_) | GuideState::Waiting));
        self.waits = if waits { self.waits.or(Some(now)) } else { None };
        self.lives(now);
    }

    fn lives(&mut self, now: Stamp) {
        if self.lived || now - self.calm < LIVE_S {
            return;
        }
        self.lived = true;
        use StopReason::{CannotRelocalise, StageDied, ToAndFro};
        // The last is said again and again after a failure of the program.
        let refuses = |reason| matches!(reason, CannotRelocalise | ToAndFro | StageDied);
        match self.state {
            Some(GuideState::Stopped(reason)) if !refuses(reason) => {
                self.broken(Rule::GoesOn, now, format!("stopped: {reason:?}"));
            }
            _ => {}
        }
    }

    /// The walker's ear: a sentence begins, or a sound (without a duration).
    pub fn heard(&mut self, pose: Option<Stamp>, duration_s: f64, now: Stamp) {
        self.heard = self.heard.max(now.plus_seconds(duration_s));
        if let Some(pose) = pose.filter(|pose| now - *pose > POSE_S + 1e-6) {
            self.broken(Rule::FreshPose, now, format!("heard {:.2} s old", now - pose));
        }
    }

    /// The walker has gone on for a moment.
    pub fn stepped(&mut self, walker: (f64, f64, f64), now: Stamp) {
        let silent_s = SILENT_S + if self.over_network { ON_THE_WAY_S } else { 0.1 };
        if let Some(since) = self.waits
            && now - since.max(self.heard) > silent_s
        {
            self.broken(Rule::NotSilent, now, format!("{:?}", self.state));
            self.heard = now;
        }
        if let Some((at, far_m)) = self.arrived {
            self.arrived = Some((at, far_m.min(self.truth.from_end_m(walker))));
            if now - at > 3.0 && far_m > ARRIVED_M && now - at < 3.1 && !self.is_forgiven(at) {
                self.broken(Rule::ArrivesAtTheEnd, now, format!("{far_m:.1} m from it"));
            }
        }
    }

    /// What was said to be saved is not there.
    pub fn lost(&mut self, how: String, now: Stamp) {
        self.broken(Rule::KeepsRoutes, now, how);
    }

    /// Where the walker truly is on the route.
    pub fn place(&self) -> Option<Match> {
        self.truth.place()
    }

    /// Metres from the end at arrival.
    pub fn arrived_m(&self) -> Option<f64> {
        self.arrived.map(|(_, far_m)| far_m)
    }

    /// All that was broken.
    pub fn finish(self) -> Vec<Violation> {
        self.violations
    }

    /// How many were broken so far.
    pub fn violations(&self) -> &[Violation] {
        &self.violations
    }
}

/// Whether a sentence names a number of metres.
fn says_metres(text: &str, language: Language) -> bool {
    let unit = match language {
        Language::English => "metre",
        Language::Spanish => "metro",
        Language::German => "Meter",
    };
    text.split(unit)
        .zip(text.split(unit).skip(1))
        .any(|(before, _)| before.trim_end().ends_with(|c: char| c.is_ascii_digit()))
}
