//! Judges a trial by ground truth: where the walker really was and to which side the words sent him.

use super::config::{STEP_S, TrialConfig, guide_config};
use super::rules::Rule;
use crate::walker::{Walker, side_of};
use cairn_geometry::Vec2;
use cairn_guide::{
    Cue, CueKind, Facing, Heading, ManeuverPlan, Match, Matcher, MatcherConfig, Side, Utterance, heading_of,
    wrap,
};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use std::collections::BTreeMap;
use std::f64::consts::PI;

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

/// So far from a sharp corner its two legs lie within reach of each other, metres along each.
const HAIRPIN_M: f64 = 8.0;

pub(crate) struct Judge {
    plan: ManeuverPlan,
    language: Language,
    facing: Facing,
    off_m: f64,
    dwell_s: f64,
    matcher: Matcher,
    at: Option<Match>,
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
            plan,
            language: config.phrases.language,
            facing: config.facing,
            off_m: s.off_m,
            dwell_s: s.off_dwell_s,
            matcher: Matcher::new(MatcherConfig::default()),
            at: None,
            place_m: None,
            off_s: 0.0,
            off: false,
            last_kind: None,
            outcome,
        }
    }

    pub fn length(&self) -> f64 {
        self.plan.length()
    }

    fn true_heading(&self, walker: &Walker) -> Heading {
        let (x, y, heading) = walker.pose();
        let course = if self.facing == Facing::Backwards { wrap(heading + PI) } else { heading };
        Heading { position: Vec2::new(x, y), height: 1.3, heading, course }
    }

    /// The leg after a hairpin, for a walker who faces along it: metres along the route of its begin and of its nearest point. Where
    /// two legs lie at an acute angle the matcher alone would keep him on the first, backwards, while he goes away from it.
    fn faced_leg(&self, truth: &Heading) -> Option<[f64; 2]> {
        let along_m = self.at?.along_m;
        let corners: Vec<_> = self.plan.maneuvers().iter().filter(|m| m.turn_rad != 0.0).collect();
        let taken = (0..corners.len()).find(|k| {
            let m = corners[*k];
            // No other corner lies between the walker and this one.
            let next = (*k == 0 || corners[k - 1].end_m <= along_m)
                && corners.get(k + 1).is_none_or(|after| along_m <= after.at_m);
            let near = (m.at_m - along_m).abs() <= HAIRPIN_M;
            let faces = truth.turn_to(m.exit_heading).abs() < PI / 3.0;
            next && near && faces && m.turn_rad.abs() > PI / 2.0
        })?;
        let end_m = corners[taken].end_m;
        // Not farther than that leg goes: the one after it may cross the leg that the walker is on.
        let leg_m = corners.get(taken + 1).map_or(self.plan.length(), |next| next.at_m) - end_m;
        let steps = (HAIRPIN_M.min(leg_m) / 0.1) as usize;
        let after = (0..=steps).map(|k| end_m + 0.1 * k as f64);
        let nearest = after.min_by(|a, b| self.away(*a, truth).total_cmp(&self.away(*b, truth)))?;
        Some([end_m, nearest])
    }

    /// Metres from the walker to the route at a distance along it.
    fn away(&self, along_m: f64, truth: &Heading) -> f64 {
        (self.plan.point_at(along_m) - truth.position).norm()
    }

    /// A walker who faces along the leg after a hairpin and is nearer to it than to the leg before is on it.
    fn pass_hairpin(&mut self, truth: &Heading) {
        let (Some(at), Some([end_m, nearest_m])) = (self.at, self.faced_leg(truth)) else { return };
        if self.away(nearest_m, truth) < self.away(at.along_m, truth) {
            self.matcher.pass(end_m);
        }
    }

    /// `place_m`: the guide's own estimate of the distance along the route.
    pub fn see(&mut self, walker: &Walker, cue: Option<&Cue>, place_m: Option<f64>, now: Stamp) {
        let truth = self.true_heading(walker);
        self.pass_hairpin(&truth);
        let at = self.matcher.update(&self.plan, &truth.position, now);
        self.at = Some(at);
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
        self.at
    }

    pub fn hear(&mut self, said: &Utterance, walker: &Walker, now: Stamp) -> Said {
        let truth = self.true_heading(walker);
        let along_m = self.at.map_or(0.0, |m| m.along_m);
        // Where two legs lie within reach of each other, or the walker is as near to either, the words may refer to either. Who has
        // turned at a hairpin goes along the leg after it, however far beside it he turned.
        let there = self.place_m.filter(|m| {
            let reach_m = self.off_m.max(self.away(along_m, &truth));
            self.away(*m, &truth) <= reach_m && (*m - along_m).abs() > 1.0
        });
        // Who looks round for his place is sent nowhere.
        let side = side_of(&said.text, self.language)
            .filter(|_| !matches!(self.last_kind, Some(CueKind::LookRound(_))));
        let wrong_side = side.is_some_and(|side| {
            [Some(along_m), there, self.faced_leg(&truth).map(|leg| leg[1])]
                .into_iter()
                .flatten()
                .all(|m| self.wrong(side, &truth, m))
        });
        self.outcome.wrong_side += usize::from(wrong_side);
        if let Some(kind) = &self.last_kind {
            *self.outcome.kinds.entry(name(kind)).or_default() += 1;
        }
        let (x, y) = (truth.position.x, truth.position.y);
        let said = Said { t: now.seconds(), along_m, text: said.text.clone(), x, y, wrong_side };
        self.outcome.said.push(said.clone());
        said
    }

    /// Whether the words truly send the walker away from the route.
    fn wrong(&self, side: Side, truth: &Heading, along_m: f64) -> bool {
        let limit = 20.0_f64.to_radians();
        let against = |needed: f64, limit: f64| match side {
            Side::Left => needed < -limit,
            Side::Right => needed > limit,
        };
        match self.last_kind {
            Some(CueKind::Step(_)) => {
                let foot = self.plan.point_at(along_m);
                against(truth.to_left(&foot), 0.1)
            }
            Some(CueKind::TurnNow { .. }) => {
                // One of the corners here must turn that route, seen from the walker's heading.
                let here = |m: &&cairn_guide::Maneuver| {
                    m.turn_rad != 0.0 && m.at_m - along_m < 4.0 && along_m - m.end_m < 4.0
                };
                !self.plan.maneuvers().iter().filter(here).any(|m| {
                    let needed = truth.turn_to(m.exit_heading);
                    // From 150 degrees on both sides lead there.
                    !against(needed, limit) || needed.abs() >= 150.0_f64.to_radians()
                })
            }
            // Away from the route at look-ahead distances of both one and three metres.
            _ => [1.0, 3.0].iter().all(|ahead| {
                let target = self.plan.point_at((along_m + ahead).min(self.plan.length()));
                let needed = truth.turn_to(heading_of(&(target - truth.position)));
                against(needed, limit) && needed.abs() < 150.0_f64.to_radians()
            }),
        }
    }

    pub fn finish(mut self, walker: &Walker, arrived: bool) -> Outcome {
        self.outcome.arrived = arrived;
        self.outcome.error_m = (self.true_heading(walker).position - self.plan.end()).norm();
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
    use cairn_guide::Priority;
    use cairn_guide::{Ground, ManeuverPlanConfig};

    /// The leg after the next one crosses the leg that the walker is on: being near to it is not being past a hairpin before it.
    #[test]
    fn a_walker_near_a_crossing_is_not_past_the_hairpin_before_it() {
        let corners = [[-0.9, 7.2], [-2.7, 9.1], [-4.5, 7.2], [-5.2, 9.3], [-2.5, 10.7], [-3.4, -3.0]];
        let line: Vec<Vec3> = corners.iter().map(|c| Vec3::new(c[0], c[1], 0.0)).collect();
        let plan = ManeuverPlan::new(&line, &Ground::z_up(), &ManeuverPlanConfig::default()).unwrap();
        let config = TrialConfig {
            facing: Facing::Home,
            travel: cairn_guide::Travel::Again,
            noise: Noise::None,
            corridor_m: 3.0,
            cut_detours: false,
            phrases: cairn_guide::PhraseConfig::default(),
            seed: 0,
        };
        let mut judge = Judge::new(plan, &config);
        let walker = Walker::new(0, (-2.2, 7.7, 2.06));
        for k in 0..3 {
            judge.see(&walker, None, None, Stamp::from_seconds(k as f64 * STEP_S));
        }
        let along_m = judge.at.unwrap().along_m;
        assert!((0.9..1.6).contains(&along_m), "{along_m}");
    }

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
            judge.matcher.place(8.5);
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
