//! Judges a trial by ground truth: where the walker really was and to which side the words sent him.

use super::config::{STEP_S, TrialConfig, guide_config};
use super::rules::Rule;
use super::truth::{RouteTruth, Sent};
use crate::walker::{Walker, side_of};
use cairn_guide::{Cue, CueKind, ManeuverPlan, Match, Utterance};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use std::collections::BTreeMap;

/// One line of a transcript.
#[derive(Clone, Debug, PartialEq)]
pub struct Said {
    /// Seconds from the start.
    pub t: f64,
    /// True distance along the way home, metres.
    pub along_m: f64,
    /// The words.
    pub text: String,
    /// True position, x in metres.
    pub x: f64,
    /// True position, y in metres.
    pub y: f64,
    /// The words sent the walker to the wrong side.
    pub wrong_side: bool,
}

/// The result of a trial.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Outcome {
    /// The guide said that the route has ended.
    pub arrived: bool,
    /// True distance from the walker to the end of the route, metres.
    pub error_m: f64,
    /// How many times the walker was truly off the path for 2 s.
    pub off_path: usize,
    /// Directions to the wrong side.
    pub wrong_side: usize,
    /// Length of the way home, metres.
    pub length_m: f64,
    /// Duration in seconds.
    pub seconds: f64,
    /// The utterances.
    pub said: Vec<Said>,
    /// Utterances by kind of cue.
    pub kinds: BTreeMap<&'static str, usize>,
    /// On-course ticks and other sounds.
    pub sounds: usize,
    /// The rules that were broken, and when, seconds.
    pub broken: Vec<(f64, Rule)>,
}

impl Outcome {
    /// The transcript as text, one utterance a line.
    pub fn transcript(&self) -> String {
        let line = |s: &Said| {
            let flag = if s.wrong_side { "  [wrong side]" } else { "" };
            format!("{:>5.0} s {:>4.0} m  {}{flag}\n", s.t, s.along_m, s.text)
        };
        self.said.iter().map(line).collect()
    }
}

/// Sums over trials.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Trials.
    pub trials: usize,
    /// Arrived within 1 m.
    pub arrived: usize,
    /// Off-path events.
    pub off_path: usize,
    /// Directions to the wrong side.
    pub wrong_side: usize,
    /// Utterances.
    pub said: usize,
    /// Metres.
    pub metres: f64,
    /// Arrival errors of all trials, metres.
    pub errors_m: Vec<f64>,
    /// Utterances by kind.
    pub kinds: BTreeMap<&'static str, usize>,
    /// How often each rule was broken.
    pub broken: BTreeMap<Rule, usize>,
}

impl Tally {
    /// Adds a trial.
    pub fn add(&mut self, o: &Outcome) {
        self.trials += 1;
        self.arrived += usize::from(o.arrived && o.error_m <= 1.0);
        self.off_path += o.off_path;
        self.wrong_side += o.wrong_side;
        self.said += o.said.len();
        self.metres += o.length_m;
        self.errors_m.push(o.error_m);
        o.kinds.iter().for_each(|(name, n)| *self.kinds.entry(name).or_default() += n);
        o.broken.iter().for_each(|(_, rule)| *self.broken.entry(*rule).or_default() += 1);
    }

    /// Rules that were broken more often than they may be, and how often.
    pub fn broken_too_often(&self) -> Vec<(Rule, usize)> {
        let most = |rule: Rule| (rule.most_on_1000_walks() * self.trials).div_ceil(1000);
        self.broken.iter().map(|(rule, n)| (*rule, *n)).filter(|(rule, n)| *n > most(*rule)).collect()
    }

    /// Share that arrived within 1 m.
    pub fn arrival_rate(&self) -> f64 {
        self.arrived as f64 / self.trials.max(1) as f64
    }

    /// Off-path events per 50 m.
    pub fn off_path_per_50_m(&self) -> f64 {
        50.0 * self.off_path as f64 / self.metres.max(1e-9)
    }

    /// Utterances per 100 m.
    pub fn said_per_100_m(&self) -> f64 {
        100.0 * self.said as f64 / self.metres.max(1e-9)
    }
}

pub(crate) struct Judge {
    truth: RouteTruth,
    language: Language,
    off_m: f64,
    dwell_s: f64,
    place_m: Option<f64>,
    off_s: f64,
    off: bool,
    last_kind: Option<CueKind>,
    outcome: Outcome,
}

impl Judge {
    pub fn new(plan: ManeuverPlan, config: &TrialConfig) -> Self {
        let s = guide_config(config.facing, config.corridor_m);
        let outcome = Outcome { length_m: plan.length(), ..Outcome::default() };
        Self {
            truth: RouteTruth::new(plan, config.facing, s.off_m),
            language: config.phrases.language,
            off_m: s.off_m,
            dwell_s: s.off_dwell_s,
            place_m: None,
            off_s: 0.0,
            off: false,
            last_kind: None,
            outcome,
        }
    }

    pub fn length(&self) -> f64 {
        self.outcome.length_m
    }

    /// `place_m`: the guide's own estimate of the distance along the route.
    pub fn see(&mut self, walker: &Walker, cue: Option<&Cue>, place_m: Option<f64>, now: Stamp) {
        let at = self.truth.see(walker.pose(), now);
        self.place_m = place_m;
        self.off_s = if at.cross_m.abs() > self.off_m { self.off_s + STEP_S } else { 0.0 };
        if self.off_s >= self.dwell_s && !self.off {
            self.off = true;
            self.outcome.off_path += 1;
        } else if self.off_s == 0.0 {
            self.off = false;
        }
        self.outcome.seconds = now.seconds();
        if let Some(cue) = cue {
            if cue.kind.is_sound() {
                self.outcome.sounds += 1;
            } else {
                self.last_kind = Some(cue.kind);
            }
        }
    }

    /// Where the walker truly is on the route.
    pub fn place(&self) -> Option<Match> {
        self.truth.place()
    }

    pub fn hear(&mut self, said: &Utterance, walker: &Walker, now: Stamp) -> Said {
        // Who looks round for his place is sent nowhere.
        let side = side_of(&said.text, self.language)
            .filter(|_| !matches!(self.last_kind, Some(CueKind::LookRound(_))));
        let sent = match self.last_kind {
            Some(CueKind::Step(_)) => Sent::Aside,
            Some(CueKind::TurnNow { .. }) => Sent::Round,
            _ => Sent::Along,
        };
        let wrong_side =
            side.is_some_and(|side| self.truth.is_wrong(side, sent, walker.pose(), self.place_m));
        self.outcome.wrong_side += usize::from(wrong_side);
        if let Some(kind) = &self.last_kind {
            *self.outcome.kinds.entry(name(kind)).or_default() += 1;
        }
        let (x, y, _) = walker.pose();
        let along_m = self.place().map_or(0.0, |m| m.along_m);
        let said = Said { t: now.seconds(), along_m, text: said.text.clone(), x, y, wrong_side };
        self.outcome.said.push(said.clone());
        said
    }

    pub fn finish(mut self, walker: &Walker, arrived: bool) -> Outcome {
        self.outcome.arrived = arrived;
        self.outcome.error_m = self.truth.from_end_m(walker.pose());
        self.outcome
    }
}

fn name(kind: &CueKind) -> &'static str {
    match kind {
        CueKind::Start { .. } => "start",
        CueKind::Away { .. } => "away",
        CueKind::Resume(_) => "resume",
        CueKind::Clear(_) => "clear",
        CueKind::Around(_) => "around",
        CueKind::Correction(_) => "correction",
        CueKind::Approach(_) => "approach",
        CueKind::TurnNow { .. } | CueKind::StairsNow(_) => "turn now",
        CueKind::Rotate(_) => "rotate",
        CueKind::StopTurning(_) => "stop turning",
        CueKind::StandStill => "stand still",
        CueKind::Go { .. } => "go",
        CueKind::Adjust(_) => "adjust",
        CueKind::Progress(_) => "progress",
        CueKind::OffPath { .. } => "off path",
        CueKind::WrongWay(_) => "wrong way",
        CueKind::Stopped { .. } => "stopped",
        CueKind::CheckBehind => "check behind",
        CueKind::Step(_) => "step aside",
        CueKind::SlowDown | CueKind::Weak => "slow down",
        CueKind::Arrived => "arrived",
        CueKind::EndMissed { .. } => "end missed",
        CueKind::LookRound(_) => "look round",
        CueKind::Stop(_) => "stop",
        CueKind::Waypoint
        | CueKind::OnCourse
        | CueKind::Turning(_)
        | CueKind::BackOnPath
        | CueKind::StillHere => "sound",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::walk::Noise;
    use cairn_geometry::Vec3;
    use cairn_guide::{Facing, Ground, ManeuverPlanConfig, Priority};

    #[test]
    fn judge_counts_wrong_sides_and_off_path_events() {
        let corners = [Vec3::zeros(), Vec3::new(10.0, 0.0, 0.0), Vec3::new(10.0, 10.0, 0.0)];
        let plan = ManeuverPlan::new(&corners, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
        let config = TrialConfig {
            facing: Facing::Home,
            travel: cairn_guide::Travel::Home,
            noise: Noise::None,
            corridor_m: 3.0,
            cut_detours: true,
            phrases: cairn_guide::PhraseConfig::default(),
            seed: 0,
        };
        for (text, wrong) in [("Turn left now.", 0), ("Turn right now.", 1), ("Turn around.", 0)] {
            let mut judge = Judge::new(plan.clone(), &config);
            judge.truth.matcher.place(8.5);
            let walker = Walker::new(0, (8.5, 0.0, 0.0));
            let kind = CueKind::TurnNow { turn_rad: 1.5, stairs: None };
            let cue = Cue { stamp: Stamp(0), facing: Facing::Home, kind };
            judge.see(&walker, Some(&cue), None, Stamp(0));
            let said = Utterance {
                text: text.into(),
                priority: Priority::High,
                stamp: Stamp(0),
                duration_s: 1.0,
                interrupts: false,
            };
            judge.hear(&said, &walker, Stamp(0));
            assert_eq!(judge.outcome.wrong_side, wrong, "{text}");
        }
        let mut judge = Judge::new(plan, &config);
        let walker = Walker::new(0, (5.0, 2.0, 0.0));
        for k in 0..100 {
            judge.see(&walker, None, None, Stamp::from_seconds(k as f64 * STEP_S));
        }
        assert_eq!(judge.finish(&walker, true).off_path, 1);
    }
}
