//! Stops: why the walker is stopped, how often he is told, and when directions may begin again.

use crate::blind::Blind;
use crate::config::GuideConfig;
use crate::cue::{CueKind, StopReason};
use crate::facing::Heading;
use crate::input::GuideInput;
use crate::losses::Losses;
use crate::route::Confidence;
use crate::runaway::Runaway;
use crate::to_and_fro::ToAndFro;
use cairn_geometry::Vec2;
use cairn_sensor::Stamp;

/// How many times "stop" is said while tracking is lost before the walker is asked to look round.
const STOPS_BEFORE_LOOK_ROUND: u32 = 4;
/// Seconds for which the first pose is waited for in silence.
const SILENT_S: f64 = 10.0;
/// A step is said so long after "stop", which is heard first, seconds, ...
const STEP_AFTER_S: f64 = 1.0;
/// ... and again where it has not been made after so long.
const STEP_AGAIN_S: f64 = 6.0;
/// Angle of each turn that a lost walker is asked for, radians.
const LOOK_ROUND_RAD: f64 = 0.7;

/// A stop under way.
#[derive(Clone, Copy, Debug)]
struct Halt {
    reason: StopReason,
    /// When it was due last, and when that or a step was said last.
    said: Stamp,
    spoke: Stamp,
    /// How many times it was said.
    times: u32,
    /// It is to be said at once, however short ago it was said.
    at_once: bool,
    good_since: Option<Stamp>,
}

/// Whether directions may be given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Recovery {
    /// There was no stop.
    Free,
    /// Poses have not been good for long enough.
    Waiting,
    /// The stop ends now.
    Ends {
        /// It was for something in the way.
        in_the_way: bool,
    },
}

/// The stops of a walk. Where `started` is asked for, it says whether the walker has been told to move.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stops {
    halted: Option<Halt>,
    losses: Losses,
    blind: Blind,
    runaway: Runaway,
    to_and_fro: ToAndFro,
    /// Since when the first pose is waited for.
    waiting_since: Option<Stamp>,
}

impl Stops {
    /// The reason of the stop under way.
    pub(crate) fn reason(&self) -> Option<StopReason> {
        self.halted.map(|halt| halt.reason)
    }

    /// Whether a walker who stands may be told to make a step, for the first time or again.
    pub(crate) fn may_step(&self, told: bool, now: Stamp) -> bool {
        let wait_s = if told { STEP_AGAIN_S } else { STEP_AFTER_S };
        self.halted.is_some_and(|halt| now - halt.spoke >= wait_s)
    }

    /// A walker was told to make a step, or has made it: "stop" is due again as long after it as after "stop".
    pub(crate) fn told_to_step(&mut self, now: Stamp) {
        if let Some(halt) = &mut self.halted {
            (halt.said, halt.spoke) = (now, now);
        }
    }

    /// "Stop" is due at once.
    pub(crate) fn say_again(&mut self) {
        if let Some(halt) = &mut self.halted {
            halt.at_once = true;
        }
    }

    /// "Stop" is said now.
    pub(crate) fn spoke(&mut self, now: Stamp) {
        if let Some(halt) = &mut self.halted {
            halt.spoke = now;
        }
    }

    /// The poses from now on have nothing to do with those before.
    pub(crate) fn begin_segment(&mut self) {
        self.runaway = Runaway::default();
        self.blind.begin_segment();
        self.to_and_fro.begin_segment();
    }

    /// A correction makes the route longer by so many metres, and leaves the walker as far from its end as he was: what is behind
    /// him has another length, and he has not walked it.
    pub(crate) fn route_lengthens(&mut self, metres: f64) {
        self.to_and_fro.shift(metres);
    }

    /// Why directions do not help at this place, metres along the route: tracking would only be lost again, or the walker led to
    /// and fro.
    pub(crate) fn final_at(&self, along_m: f64, now: Stamp) -> Option<StopReason> {
        if self.losses.are_final_at(along_m) {
            Some(StopReason::CannotRelocalise)
        } else if self.to_and_fro.is_final_at(along_m, now) {
            Some(StopReason::ToAndFro)
        } else {
            None
        }
    }

    /// Takes where a walker is led who has been told to move: metres along the route, and on the ground.
    pub(crate) fn led(&mut self, now: Stamp, along_m: f64, position: Vec2) {
        self.to_and_fro.step(now, along_m, position);
    }

    /// Why the walker must stop now, if he must.
    pub(crate) fn due(
        &mut self,
        input: &GuideInput,
        walker: Option<&Heading>,
        config: &GuideConfig,
    ) -> Option<StopReason> {
        let blind_s = walker
            .map_or(0.0, |w| self.blind.step(input.confidence, input.pose_stamp, w.position, w.heading));
        if input.confidence == Confidence::Lost {
            self.runaway = Runaway::default();
        }
        let runs_away = walker.is_some_and(|w| self.runaway.step(input.pose_stamp, w.position));
        if input.hazard.is_some() {
            input.hazard
        } else if input.confidence == Confidence::Lost {
            Some(StopReason::TrackingLost)
        } else if input.now - input.pose_stamp > config.stale_s {
            Some(StopReason::PoseStale)
        } else if blind_s > config.blind_s || runs_away {
            Some(StopReason::TrackingLost)
        } else {
            None
        }
    }

    /// Counts a loss of tracking that begins now; where it is one too many, or lasts too long, that is the reason.
    pub(crate) fn or_given_up(
        &mut self,
        reason: StopReason,
        along_m: f64,
        now: Stamp,
        started: bool,
    ) -> StopReason {
        if reason != StopReason::TrackingLost || !started {
            return reason;
        }
        if self.halted.is_none() {
            self.losses.begin(along_m, now);
        }
        if self.losses.are_final(now) { StopReason::CannotRelocalise } else { reason }
    }

    /// Says stop at once, and again while the reason lasts. A walker who has to look round turns against `turn_rate`, rad/s,
    /// by which he turned when tracking was lost.
    pub(crate) fn halt(
        &mut self,
        reason: StopReason,
        now: Stamp,
        config: &GuideConfig,
        turn_rate: f64,
        started: bool,
    ) -> Option<CueKind> {
        if !started && self.halted.is_none() && reason == StopReason::TrackingLost {
            // The walker was not told to move yet: wait for the first pose in silence, but not for long.
            let since = *self.waiting_since.get_or_insert(now);
            if now - since < SILENT_S {
                return None;
            }
        }
        let before =
            self.halted.filter(|h| h.reason.is_like(&reason) && !h.at_once).map(|h| (h.said, h.times));
        // Advice is two sentences and a turn of the body: it takes a while to say and to follow.
        let again_s = match reason {
            StopReason::ScaleUncertain
            | StopReason::CannotRelocalise
            | StopReason::ToAndFro
            | StopReason::NoWayPast => config.advice_again_s,
            _ => config.stop_again_s,
        };
        let (said, times) = match before {
            Some((said, times)) if now - said < again_s => (said, times),
            Some((_, times)) => (now, times + 1),
            None => (now, 1),
        };
        let due = before.is_none_or(|(_, n)| n != times);
        let spoke = self.halted.map_or(now, |halt| halt.spoke);
        self.halted = Some(Halt { reason, said, spoke, times, at_once: false, good_since: None });
        // Waiting does not recover tracking; mapped views do. They lie on the side that the walker turned from.
        if reason == StopReason::TrackingLost && times > STOPS_BEFORE_LOOK_ROUND {
            let back = if turn_rate > 0.0 { -1.0 } else { 1.0 };
            // Only every second time, so that a "stop" does not cut the turn short.
            return (due && times % 2 == 0).then_some(CueKind::LookRound(back * LOOK_ROUND_RAD));
        }
        due.then_some(CueKind::Stop(reason))
    }

    /// Whether directions may be given now; after a stop only once poses have been good for [`GuideConfig::resume_s`].
    pub(crate) fn recover(&mut self, now: Stamp, config: &GuideConfig) -> Recovery {
        let Some(halt) = &mut self.halted else { return Recovery::Free };
        let since = *halt.good_since.get_or_insert(now);
        if now - since < config.resume_s {
            return Recovery::Waiting;
        }
        let in_the_way = halt.reason.is_in_the_way();
        self.halted = None;
        self.losses.resume(now);
        Recovery::Ends { in_the_way }
    }
}
