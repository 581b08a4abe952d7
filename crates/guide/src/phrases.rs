//! From cues to sentences of the catalogue ([`cairn_phrases`]), in the walker's language and units.
//!
//! An instruction is a landmark, the action, and what comes next. The first clause says what to do now, so that it can
//! be acted on while the rest is still being said. Here the clauses are chosen and put together; their words are in
//! the language's file.

use crate::cue::{AT_START_M, Cue, CueKind, First, Next, Obstacle, Step, StopReason, UpcomingManeuver};
use crate::direction::{Direction, Side};
use crate::facing::Facing;
use crate::maneuvers::Stairs;
use cairn_phrases::{Arg, Language};

/// The unit in which distances are said.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Unit {
    /// Metres.
    Metres,
    /// Feet.
    Feet,
    /// Steps of this many metres (blind walkers do best with them: Kalia et al. 2010).
    Steps(f64),
}

/// The form in which directions are said.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DirectionStyle {
    /// "slightly left", "left", "sharp left", "around".
    Words,
    /// "to 9 o'clock".
    Clock,
    /// "left 90 degrees", to the nearest ten.
    Degrees,
}

/// Config of the phrases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PhraseConfig {
    /// The language.
    pub language: Language,
    /// The unit of distances.
    pub unit: Unit,
    /// The form of directions.
    pub directions: DirectionStyle,
    /// False when the scale is unknown: then no distance is said, only "soon" or "now".
    pub metric: bool,
}

impl Default for PhraseConfig {
    fn default() -> Self {
        Self {
            language: Language::default(),
            unit: Unit::Metres,
            directions: DirectionStyle::Words,
            metric: true,
        }
    }
}

/// How a turn is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Manner {
    /// At a turn of the route.
    Corner,
    /// Standing.
    Spot,
    /// By a walker who moves backwards.
    Backwards,
}

impl Manner {
    fn name(self) -> &'static str {
        match self {
            Self::Corner => "corner",
            Self::Spot => "spot",
            Self::Backwards => "back",
        }
    }
}

impl PhraseConfig {
    /// The words of a cue; `None` for cues that are sounds only.
    pub fn words(&self, cue: &Cue) -> Option<String> {
        let back = cue.facing == Facing::Backwards;
        let text = |id: &str| self.language.text(id);
        let after = |id: &str, rest: String| format!("{} {rest}", text(id));
        let turn = |angle_rad: f64| self.turn(angle_rad, if back { Manner::Backwards } else { Manner::Spot });
        Some(match cue.kind {
            CueKind::Start { total_m, left_m, first } => self.start(total_m, left_m, &first, cue.facing),
            CueKind::Away { distance_m, bearing_rad } => self.measured(
                ["guide-away", "guide-away-unmeasured"],
                distance_m,
                &[("place", (&self.place(bearing_rad, back)).into())],
            ),
            CueKind::Resume(first) => after("guide-found", self.first(&first, back)),
            CueKind::Clear(first) => after("guide-clear", self.first(&first, back)),
            CueKind::Around(First::Turn(a)) => self.with("guide-around", "turn", &turn(a)),
            CueKind::Around(First::Go(_)) => text("guide-around-ahead"),
            CueKind::Correction(first) => after("guide-correction", self.first(&first, back)),
            CueKind::Approach(ahead) => self.approach(&ahead, back),
            CueKind::TurnNow { turn_rad, stairs } => self.turn_now(turn_rad, stairs, back),
            CueKind::StairsNow(stairs) => self.with("guide-stairs-now", "stairs", &self.stairs(stairs)),
            CueKind::Rotate(a) if back => after("guide-stop", self.sentence(&turn(a))),
            CueKind::Rotate(a) => self.sentence(&turn(a)),
            CueKind::StopTurning(ahead) => after("guide-stop-turning", self.go(&ahead, back, back)),
            CueKind::StandStill => text("guide-stand-still"),
            CueKind::Go { ahead, check } => self.go(&ahead, back, check),
            CueKind::Adjust(a) => self.sentence(&self.bear(a, back)),
            CueKind::Progress(ahead) => self.progress(&ahead, back),
            CueKind::OffPath { distance_m, bearing_rad, turn_rad, on_spot } => {
                let turn = if on_spot { turn(turn_rad) } else { self.bear(turn_rad, back) };
                self.off_path(distance_m, bearing_rad, (turn_rad != 0.0).then_some(turn), back)
            }
            CueKind::WrongWay(a) => self.with("guide-wrong-way", "turn", &turn(a)),
            CueKind::Stopped { ahead, on_path: true } => after("guide-on-path", self.go(&ahead, back, false)),
            CueKind::Stopped { ahead, on_path: false } => self.go(&ahead, back, false),
            CueKind::CheckBehind => after("guide-stop", text("guide-check-behind")),
            CueKind::Step(step) => {
                let text = match step {
                    Step::BackAside(_) => "guide-step-aside",
                    Step::Aside(_) => "guide-small-step",
                };
                self.with(text, "side", Side::of(step.side()).name())
            }
            CueKind::SlowDown => text("guide-slow-down"),
            CueKind::Weak => text("guide-weak"),
            CueKind::EndMissed { distance_m, turn_rad } => self.measured(
                ["guide-end-missed", "guide-end-missed-unmeasured"],
                distance_m,
                &[("turn", (&turn(turn_rad)).into())],
            ),
            CueKind::Arrived => text("guide-arrived"),
            CueKind::LookRound(a) => self.with("guide-look-round", "turn", &turn(a)),
            CueKind::Stop(StopReason::Obstacle(obstacle)) if self.metric => {
                after("guide-stop", self.obstacle(&obstacle))
            }
            CueKind::Stop(reason) => after("guide-stop", reason_words(reason, cue.facing, self.language)),
            CueKind::Waypoint
            | CueKind::OnCourse
            | CueKind::Turning(_)
            | CueKind::BackOnPath
            | CueKind::StillHere => return None,
        })
    }

    /// What is in the way, and where: "Something is in the way, half a metre to your left."
    fn obstacle(&self, obstacle: &Obstacle) -> String {
        let (ahead, left) = (f64::from(obstacle.ahead_cm) / 100.0, f64::from(obstacle.left_cm) / 100.0);
        let far = ahead.hypot(left);
        let near = self.unit == Unit::Metres && far < 0.75;
        let side = Side::of(left);
        let place = match (left.abs(), side) {
            (l, _) if l < 0.15 => "ahead",
            (l, Side::Left) if l < 0.6 * ahead => "ahead-left",
            (l, Side::Right) if l < 0.6 * ahead => "ahead-right",
            _ => side.name(),
        };
        let what = if obstacle.overhead { "overhead" } else { "standing" };
        let how_far = if near { "near" } else { "far" };
        let args: [(&str, Arg); 3] =
            [("what", what.into()), ("near", how_far.into()), ("place", place.into())];
        self.language.say("guide-obstacle", &[&args[..], &self.rounded(far)].concat())
    }

    /// A distance in words in the configured unit: rounded to 1 below 10, to 5 from 10, to 10 from 50.
    pub fn distance(&self, metres: f64) -> String {
        self.language.say("distance", &self.rounded(metres))
    }

    /// The sentence with this id, and the distance in it; without a known scale the other one.
    pub fn measured(&self, [measured, unmeasured]: [&str; 2], metres: f64, args: &[(&str, Arg)]) -> String {
        match self.metric {
            true => self.language.say(measured, &[args, &self.rounded(metres)].concat()),
            false => self.language.say(unmeasured, args),
        }
    }

    /// The values of a distance, for the catalogue.
    fn rounded(&self, metres: f64) -> [(&'static str, Arg<'static>); 2] {
        let (value, unit) = match self.unit {
            Unit::Metres => (metres, "metres"),
            Unit::Feet => (metres / 0.3048, "feet"),
            Unit::Steps(length) => (metres / length.max(0.1), "steps"),
        };
        let grain = match value {
            v if v >= 50.0 => 10.0,
            v if v >= 10.0 => 5.0,
            _ => 1.0,
        };
        let rounded = ((value / grain).round() * grain).max(1.0);
        [("distance", Arg::Number(rounded, 0)), ("unit", unit.into())]
    }

    fn with(&self, id: &str, name: &str, value: &str) -> String {
        self.language.say(id, &[(name, value.into())])
    }

    fn sentence(&self, clause: &str) -> String {
        self.with("guide-sentence", "clause", clause)
    }

    fn start(&self, total_m: f64, left_m: f64, first: &First, facing: Facing) -> String {
        let joins = total_m - left_m > AT_START_M;
        let length = match joins {
            true => self.measured(["guide-join", "guide-join-unmeasured"], left_m, &[]),
            false => self.measured(["guide-start", "guide-start-unmeasured"], total_m, &[]),
        };
        let first = self.first(first, facing == Facing::Backwards);
        // What to do comes first, but for the warning of whoever is to go backwards.
        match facing {
            Facing::Home => format!("{first} {length}"),
            Facing::Back => format!("{first} {length} {}", self.language.text("guide-start-back")),
            Facing::Backwards => {
                format!("{} {first} {length}", self.language.text("guide-start-backwards"))
            }
        }
    }

    /// What to do first.
    fn first(&self, first: &First, back: bool) -> String {
        match first {
            First::Turn(a) => {
                self.sentence(&self.turn(*a, if back { Manner::Backwards } else { Manner::Spot }))
            }
            First::Go(ahead) => self.go(ahead, back, back),
        }
    }

    /// "turn left", "rotate right", "turn around".
    fn turn(&self, angle_rad: f64, manner: Manner) -> String {
        let (side, kind) = (Side::of(angle_rad), ("kind", manner.name().into()));
        let to = match (Direction::of(angle_rad), side) {
            (Direction::Straight, _) => return self.bear(angle_rad, manner == Manner::Backwards),
            (Direction::Slight(_), Side::Left) => "slightly-left",
            (Direction::Slight(_), Side::Right) => "slightly-right",
            (Direction::Turn(_), Side::Left) => "left",
            (Direction::Turn(_), Side::Right) => "right",
            (Direction::Sharp(_), Side::Left) => "sharp-left",
            (Direction::Sharp(_), Side::Right) => "sharp-right",
            (Direction::Around, _) => "around",
        };
        match self.directions {
            DirectionStyle::Words => self.language.say("guide-turn", &[kind, ("to", to.into())]),
            DirectionStyle::Clock => {
                let hour = ("hour", clock_hour(angle_rad).into());
                self.language.say("guide-turn-clock", &[kind, hour])
            }
            DirectionStyle::Degrees => {
                let degrees = (angle_rad.to_degrees().abs() / 10.0).round() * 10.0;
                let degrees = ("degrees", Arg::Number(degrees.max(10.0), 0));
                self.language.say("guide-turn-degrees", &[kind, ("side", side.name().into()), degrees])
            }
        }
    }

    /// A correction made without stopping: "bear left".
    fn bear(&self, angle_rad: f64, back: bool) -> String {
        let kind = if back { Manner::Backwards } else { Manner::Corner };
        let side = Side::of(angle_rad).name();
        self.language.say("guide-bear", &[("kind", kind.name().into()), ("side", side.into())])
    }

    fn stairs(&self, stairs: Stairs) -> String {
        let way = match stairs {
            Stairs::Up => "up",
            Stairs::Down => "down",
        };
        self.with("guide-stairs", "way", way)
    }

    fn corner(&self, turn_rad: f64, back: bool) -> String {
        self.turn(turn_rad, if back { Manner::Backwards } else { Manner::Corner })
    }

    fn next(&self, next: &Next, back: bool) -> String {
        match next {
            Next::Turn { turn_rad, stairs: None } => self.corner(*turn_rad, back),
            Next::Turn { turn_rad, stairs: Some(s) } => {
                let (turn, stairs) = (self.corner(*turn_rad, back), self.stairs(*s));
                let args = [("turn", (&turn).into()), ("stairs", (&stairs).into())];
                self.language.say("guide-turn-and-stairs", &args)
            }
            Next::Stairs(s) => self.stairs(*s),
            Next::End => self.language.text("guide-arrive"),
        }
    }

    /// ", then in 3 metres turn right" for a turn that follows soon.
    fn after(&self, ahead: &UpcomingManeuver, back: bool) -> String {
        ahead.then.as_ref().map_or(String::new(), |(metres, next)| {
            let next = self.next(next, back);
            self.measured(["guide-after", "guide-after-unmeasured"], *metres, &[("next", (&next).into())])
        })
    }

    fn go(&self, ahead: &UpcomingManeuver, back: bool, check: bool) -> String {
        // The last few metres after a halt are walked slowly, so that the walker can stop where he is told.
        let last = ahead.next == Next::End && ahead.distance_m < 3.0;
        let ids = match (back, last) {
            (true, _) => ["guide-move-back", "guide-move-back-unmeasured"],
            (false, true) => ["guide-move-slowly", "guide-move-slowly-unmeasured"],
            (false, false) => ["guide-continue", "guide-continue-unmeasured"],
        };
        let go = self.measured(ids, ahead.distance_m, &[]);
        let sentence = match &ahead.next {
            Next::End => self.with("guide-go-end", "go", &go),
            next => {
                let (next, after) = (self.next(next, back), self.after(ahead, back));
                let args = [("go", (&go).into()), ("next", (&next).into()), ("after", (&after).into())];
                self.language.say("guide-go", &args)
            }
        };
        match check {
            true => format!("{} {sentence}", self.language.text("guide-check-behind")),
            false => sentence,
        }
    }

    pub(crate) fn approach(&self, ahead: &UpcomingManeuver, back: bool) -> String {
        if ahead.next == Next::End {
            let ids = ["guide-approach-end", "guide-approach-end-unmeasured"];
            return self.measured(ids, ahead.distance_m, &[]);
        }
        let (next, after) = (self.next(&ahead.next, back), self.after(ahead, back));
        let args = [("next", (&next).into()), ("after", (&after).into())];
        self.measured(["guide-approach", "guide-approach-unmeasured"], ahead.distance_m, &args)
    }

    fn turn_now(&self, turn_rad: f64, stairs: Option<Stairs>, back: bool) -> String {
        let turn = self.corner(turn_rad, back);
        let stairs =
            stairs.map_or(String::new(), |s| self.with("guide-and-stairs", "stairs", &self.stairs(s)));
        let id = if back { "guide-turn-now-back" } else { "guide-turn-now" };
        self.language.say(id, &[("turn", (&turn).into()), ("stairs", (&stairs).into())])
    }

    fn progress(&self, ahead: &UpcomingManeuver, back: bool) -> String {
        if ahead.next == Next::End {
            let ids = ["guide-progress-end", "guide-progress-end-unmeasured"];
            return self.measured(ids, ahead.distance_m, &[]);
        }
        let next = self.next(&ahead.next, back);
        let ids = ["guide-progress", "guide-progress-unmeasured"];
        self.measured(ids, ahead.distance_m, &[("next", (&next).into())])
    }

    fn off_path(&self, distance_m: f64, bearing_rad: f64, turn: Option<String>, back: bool) -> String {
        match turn {
            // What to do comes first: the walker is still moving while this is said.
            Some(turn) => {
                let ids = ["guide-off-path", "guide-off-path-unmeasured"];
                self.measured(ids, distance_m, &[("turn", (&turn).into())])
            }
            None => {
                let place = self.place(bearing_rad, back);
                let ids = ["guide-off-path-place", "guide-off-path-place-unmeasured"];
                self.measured(ids, distance_m, &[("place", (&place).into())])
            }
        }
    }

    /// Where something lies: "to your left". A walker moving backwards has the course behind him: ahead on the course
    /// is behind the chest.
    pub(crate) fn place(&self, bearing_rad: f64, back: bool) -> String {
        if self.directions == DirectionStyle::Clock && !back {
            return self.language.say("guide-place-clock", &[("hour", clock_hour(bearing_rad).into())]);
        }
        let place = match (Direction::of(bearing_rad), back) {
            (Direction::Straight, false) => "ahead",
            (Direction::Around, true) => "front",
            (Direction::Straight, true) | (Direction::Around, false) => "behind",
            (Direction::Slight(s) | Direction::Turn(s) | Direction::Sharp(s), _) => s.name(),
        };
        self.with("guide-place", "place", place)
    }
}

/// The hour of a direction on a clock face: straight ahead is 12, a quarter to the left is 9.
pub fn clock_hour(angle_rad: f64) -> usize {
    let sector = (-angle_rad.to_degrees() / 30.0).round() as i64;
    match sector.rem_euclid(12) {
        0 => 12,
        hour => hour as usize,
    }
}

/// Why the walker must stop, in a sentence; and what helps, where he does not do that already.
pub fn reason_words(reason: StopReason, facing: Facing, language: Language) -> String {
    let id = match reason {
        StopReason::TrackingLost => "stop-tracking-lost",
        StopReason::PoseStale => "stop-no-picture",
        StopReason::PicturesLate => "stop-pictures-late",
        StopReason::AgeUnknown => "stop-age-unknown",
        StopReason::Obstacle(Obstacle { overhead: false, .. }) => "stop-obstacle",
        StopReason::Obstacle(Obstacle { overhead: true, .. }) => "stop-overhead",
        StopReason::Drop => "stop-drop",
        StopReason::UnknownGround => "stop-unknown-ground",
        StopReason::NoWayPast => "stop-no-way-past",
        StopReason::ScaleUncertain => "stop-scale",
        StopReason::CannotRelocalise => "stop-relocalise",
        StopReason::ToAndFro => "stop-to-and-fro",
        StopReason::StageDied => "stop-stage-died",
    };
    let camera = if facing == Facing::Home { "ahead" } else { "back" };
    language.say(id, &[("camera", camera.into())])
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_sensor::Stamp;

    fn words(config: &PhraseConfig, kind: CueKind) -> String {
        config.words(&Cue { stamp: Stamp(0), facing: Facing::Home, kind }).unwrap()
    }

    #[test]
    fn direction_classes_have_the_specified_limits() {
        let class = |deg: f64| Direction::of(deg.to_radians());
        assert_eq!(class(19.9), Direction::Straight);
        assert_eq!(class(20.1), Direction::Slight(Side::Left));
        assert_eq!(class(-59.9), Direction::Slight(Side::Right));
        assert_eq!(class(60.1), Direction::Turn(Side::Left));
        assert_eq!(class(-119.9), Direction::Turn(Side::Right));
        assert_eq!(class(120.1), Direction::Sharp(Side::Left));
        assert_eq!(class(-149.9), Direction::Sharp(Side::Right));
        assert_eq!(class(150.1), Direction::Around);
        assert_eq!(class(-180.0), Direction::Around);
    }

    #[test]
    fn distances_are_rounded_in_the_unit() {
        let metres = PhraseConfig::default();
        for (m, text) in [
            (0.2, "1 metre"),
            (1.4, "1 metre"),
            (9.4, "9 metres"),
            (12.4, "10 metres"),
            (12.6, "15 metres"),
            (47.4, "45 metres"),
            (56.0, "60 metres"),
            (104.0, "100 metres"),
        ] {
            assert_eq!(metres.distance(m), text);
        }
        assert_eq!(PhraseConfig { unit: Unit::Feet, ..metres }.distance(1.0), "3 feet");
        assert_eq!(PhraseConfig { unit: Unit::Steps(0.7), ..metres }.distance(7.0), "10 steps");
        assert_eq!(PhraseConfig { unit: Unit::Steps(0.0), ..metres }.distance(1.0), "10 steps");
    }

    #[test]
    fn clock_and_degree_styles() {
        for (deg, hour) in [(0, 12), (90, 9), (-90, 3), (180, 6), (-25, 1)] {
            assert_eq!(clock_hour(f64::from(deg).to_radians()), hour);
        }
        let turn = CueKind::TurnNow { turn_rad: 1.6, stairs: None };
        let styled = |directions| PhraseConfig { directions, ..PhraseConfig::default() };
        assert_eq!(words(&styled(DirectionStyle::Clock), turn), "Turn to 9 o'clock now.");
        assert_eq!(words(&styled(DirectionStyle::Degrees), turn), "Turn left 90 degrees now.");
        assert_eq!(words(&PhraseConfig::default(), turn), "Turn left now.");
    }

    #[test]
    fn an_obstacle_is_said_with_side_and_distance() {
        let said = |ahead, left, overhead| {
            words(
                &PhraseConfig::default(),
                CueKind::Stop(StopReason::Obstacle(Obstacle::at(ahead, left, overhead))),
            )
        };
        assert_eq!(said(0.3, 0.4, false), "Stop. Something is in the way, half a metre to your left.");
        assert_eq!(said(2.1, 0.05, false), "Stop. Something is in the way, 2 metres ahead.");
        assert_eq!(
            said(1.6, -0.4, true),
            "Stop. Something is hanging in the way, 2 metres ahead, a little to your right."
        );
        let guessed = PhraseConfig { metric: false, ..PhraseConfig::default() };
        let obstacle = StopReason::Obstacle(Obstacle::at(1.0, 0.0, false));
        assert_eq!(words(&guessed, CueKind::Stop(obstacle)), "Stop. Something is in the way.");
    }

    #[test]
    fn nobody_is_advised_to_do_what_he_does() {
        for language in Language::ALL {
            for reason in [StopReason::ScaleUncertain, StopReason::CannotRelocalise, StopReason::ToAndFro] {
                let said = |facing| reason_words(reason, facing, language);
                let [home, back] = [Facing::Home, Facing::Back].map(said);
                assert!(back.ends_with('.') && home.starts_with(&format!("{back} ")), "{home} | {back}");
                assert_eq!(said(Facing::Backwards), back);
            }
        }
    }

    #[test]
    fn next_maneuver_is_said_with_the_action() {
        let then = Some((2.6, Next::Turn { turn_rad: -1.5, stairs: Some(Stairs::Up) }));
        let ahead =
            UpcomingManeuver { distance_m: 6.1, next: Next::Turn { turn_rad: 0.7, stairs: None }, then };
        assert_eq!(
            words(&PhraseConfig::default(), CueKind::Approach(ahead)),
            "In 6 metres, turn slightly left, then in 3 metres turn right and go upstairs."
        );
    }
}
