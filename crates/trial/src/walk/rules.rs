//! Rules that hold at every moment of a walk, whatever fails: how often each is broken.

use crate::walker::side_of;
use cairn_guide::{Cue, CueKind, GuideState, Side, Utterance};
use cairn_phrases::Language;
use cairn_sensor::Stamp;

/// Nobody who is stopped or waits hears nothing for longer, seconds.
const SILENT_S: f64 = 3.0;
/// No sentence contradicts the one before it sooner than this, seconds.
const CONTRADICTION_S: f64 = 3.0;
/// Nobody who was sent on is stopped again sooner, seconds.
const STOP_AND_GO_S: f64 = 1.0;
/// No direction comes from an older pose, seconds.
const POSE_S: f64 = 0.5;
/// Whoever is said to have arrived stands within this of the true end, metres.
const ARRIVED_M: f64 = 1.5;

/// A rule that holds at every moment of a walk.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// No direction leads away from the route or to the wrong side of it.
    RightSide,
    /// Nobody who is stopped or waits hears nothing for more than 3 s.
    NotSilent,
    /// No sentence contradicts the one within 3 s before it.
    NoContradiction,
    /// Nobody who was sent on is stopped again within a second.
    NoStopAndGo,
    /// No direction comes from a pose that is older than half a second.
    NoOldPose,
    /// "You have arrived" is said within 1.5 m of the true end alone.
    ArrivesAtTheEnd,
}

impl Rule {
    /// How it was broken.
    pub fn name(self) -> &'static str {
        match self {
            Self::RightSide => "wrong side",
            Self::NotSilent => "silent while stopped",
            Self::NoContradiction => "contradiction",
            Self::NoStopAndGo => "stop and go",
            Self::NoOldPose => "direction from an old pose",
            Self::ArrivesAtTheEnd => "arrived elsewhere",
        }
    }

    /// How often it may be broken on a thousand walks of one row of the example `walks`.
    pub fn most_on_1000_walks(self) -> usize {
        match self {
            // Who walks backwards and was corrected may be turned on the spot before he has followed: 3 on 1,500 walks.
            Self::NoContradiction => 5,
            _ => 0,
        }
    }
}

/// Watches one walk.
#[derive(Debug, Default)]
pub(crate) struct Rules {
    /// Until when the voice speaks; moved on where silence was counted.
    quiet_since: Stamp,
    halted: bool,
    /// Whether the walker turned on the spot before, and does now.
    turns: [bool; 2],
    went_on: Option<Stamp>,
    side: Option<(Stamp, Side)>,
    cue: Option<CueKind>,
    broken: Vec<(f64, Rule)>,
}

impl Rules {
    /// A step of the guide from a pose of this time, and what is said now. Returns the rules that it breaks.
    pub(crate) fn see(
        &mut self,
        cue: Option<&Cue>,
        state: GuideState,
        pose: Stamp,
        said: Option<&Utterance>,
        language: Language,
        now: Stamp,
    ) -> Vec<Rule> {
        let before = self.broken.len();
        let halted = matches!(state, GuideState::Stopped(_));
        if halted && !self.halted && self.went_on.is_some_and(|at| now - at < STOP_AND_GO_S) {
            self.count(Rule::NoStopAndGo, now);
        }
        if self.halted && !halted {
            self.went_on = Some(now);
        }
        self.halted = halted;
        self.turns = [self.turns[1], state == GuideState::Turning];
        if cue.is_some_and(|cue| cue.is_direction() && now - pose > POSE_S) {
            self.count(Rule::NoOldPose, now);
        }
        self.cue = cue.filter(|cue| !cue.kind.is_sound()).map(|cue| cue.kind).or(self.cue);
        if let Some(said) = said {
            self.hear(said, language, now);
        }
        if cue.is_some_and(|cue| cue.kind == CueKind::StillHere) {
            self.quiet_since = self.quiet_since.max(now);
        }
        let waits = halted || state == GuideState::Waiting;
        if waits && now - self.quiet_since > SILENT_S {
            self.count(Rule::NotSilent, now);
            self.quiet_since = now;
        }
        if !waits {
            self.quiet_since = self.quiet_since.max(now);
        }
        self.broken[before..].iter().map(|(_, rule)| *rule).collect()
    }

    fn hear(&mut self, said: &Utterance, language: Language, now: Stamp) {
        // Who looks round for his place is not sent to that side.
        let side = side_of(&said.text, language).filter(|_| !matches!(self.cue, Some(CueKind::LookRound(_))));
        // A corner of the route turns to the side that it turns to, whatever correction came before it, also where a walker who goes
        // backwards begins to rotate there; and who walks backwards may have to step to one side and turn to the other.
        let turns = matches!(self.cue, Some(CueKind::Rotate(_))) && self.turns == [false, true];
        let other = turns || matches!(self.cue, Some(CueKind::TurnNow { .. } | CueKind::Step(_)));
        let against =
            |(at, before): (Stamp, Side)| now - at < CONTRADICTION_S && side.is_some_and(|s| s != before);
        if !other && self.side.is_some_and(against) {
            self.count(Rule::NoContradiction, now);
        }
        self.side = side.map(|side| (now, side));
        self.quiet_since = now.plus_seconds(said.duration_s);
    }

    /// A rule is broken now.
    pub(crate) fn count(&mut self, rule: Rule, now: Stamp) {
        self.broken.push((now.seconds(), rule));
    }

    /// The walk has ended after so many seconds, this far from the true end. Returns all rules that were broken, and when.
    pub(crate) fn finish(mut self, arrived: bool, error_m: f64, seconds: f64) -> Vec<(f64, Rule)> {
        if arrived && error_m > ARRIVED_M {
            self.broken.push((seconds, Rule::ArrivesAtTheEnd));
        }
        self.broken
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_guide::{Facing, First, Priority, StopReason};

    fn said(text: &str) -> Utterance {
        let text = text.to_owned();
        Utterance { text, priority: Priority::High, stamp: Stamp(0), duration_s: 1.0, interrupts: false }
    }

    fn broken(steps: &[(f64, GuideState, Option<CueKind>, f64, &str)]) -> Vec<Rule> {
        let mut rules = Rules::default();
        for (t, state, kind, pose_s, text) in steps {
            let now = Stamp::from_seconds(*t);
            let cue = kind.map(|kind| Cue { stamp: now, facing: Facing::Home, kind });
            let said = (!text.is_empty()).then(|| said(text));
            let pose = Stamp::from_seconds(*pose_s);
            rules.see(cue.as_ref(), *state, pose, said.as_ref(), Language::English, now);
        }
        rules.finish(true, 1.4, 20.0).into_iter().map(|(_, rule)| rule).collect()
    }

    #[test]
    fn each_rule_is_broken_by_its_own_walk_and_none_by_a_good_one() {
        let stopped = GuideState::Stopped(StopReason::TrackingLost);
        let moving = GuideState::Moving;
        let bear = Some(CueKind::Adjust(0.3));
        let turn = Some(CueKind::TurnNow { turn_rad: -1.5, stairs: None });
        let go = Some(CueKind::Resume(First::Turn(0.1)));
        assert_eq!(
            broken(&[(0.0, moving, bear, 0.0, "Bear left."), (2.0, moving, bear, 2.0, "Bear right.")]),
            [Rule::NoContradiction]
        );
        assert_eq!(
            broken(&[(0.0, stopped, None, 0.0, "Stop."), (4.5, stopped, None, 4.5, "")]),
            [Rule::NotSilent]
        );
        let to_and_fro = [
            (0.0, stopped, None, 0.0, "Stop."),
            (2.0, moving, go, 2.0, ""),
            (2.5, stopped, None, 2.5, "Stop."),
        ];
        assert_eq!(broken(&to_and_fro), [Rule::NoStopAndGo]);
        assert_eq!(broken(&[(1.0, moving, bear, 0.4, "Bear left.")]), [Rule::NoOldPose]);
        let good = [
            (0.0, moving, bear, 0.0, "Bear left."),
            (2.0, moving, turn, 1.6, "Turn right now."),
            (5.5, stopped, None, 4.0, "Stop."),
            (8.5, stopped, None, 4.0, "Stop."),
            (11.0, moving, go, 11.0, "Turn left."),
            (12.5, stopped, None, 11.0, "Stop."),
        ];
        assert!(broken(&good).is_empty(), "{:?}", broken(&good));
        // Who walks backwards rotates at a corner to its side, and not to and fro there.
        let (turning, rotate) = (GuideState::Turning, |rad| Some(CueKind::Rotate(rad)));
        let corner =
            [(0.0, moving, bear, 0.0, "Rotate left."), (2.5, turning, rotate(-0.8), 2.5, "Rotate right.")];
        assert!(broken(&corner).is_empty());
        let there = [corner[1], (4.0, turning, rotate(0.3), 4.0, "Rotate left.")];
        assert_eq!(broken(&there), [Rule::NoContradiction]);
    }

    #[test]
    fn nobody_arrives_elsewhere() {
        assert_eq!(Rules::default().finish(true, 1.6, 9.0), [(9.0, Rule::ArrivesAtTheEnd)]);
    }
}
