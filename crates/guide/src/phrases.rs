//! From cues to English words.
//!
//! An instruction is a landmark, the action, and what comes next. "Continue" and "move", never "walk". The first
//! clause says what to do now, so that it can be acted on while the rest is still being said.

use crate::cue::{Ahead, Cue, CueKind, First, Next, StopReason};
use crate::facing::Facing;
use crate::maneuvers::Stairs;
use serde::{Deserialize, Serialize};

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
    /// The unit of distances.
    pub unit: Unit,
    /// The form of directions.
    pub directions: DirectionStyle,
    /// False when the scale is unknown: then no distance is said, only "soon" or "now".
    pub metric: bool,
}

impl Default for PhraseConfig {
    fn default() -> Self {
        Self { unit: Unit::Metres, directions: DirectionStyle::Words, metric: true }
    }
}

/// A side of the walker's own body.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Side {
    /// Left.
    Left,
    /// Right.
    Right,
}

/// The class of a direction, with limits at 20, 60, 120 and 150 degrees.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Below 20 degrees.
    Straight,
    /// 20 to 60.
    Slight(Side),
    /// 60 to 120.
    Turn(Side),
    /// 120 to 150.
    Sharp(Side),
    /// Above 150.
    Around,
}

impl Side {
    /// The side of an angle in radians, positive to the left.
    pub fn of(angle_rad: f64) -> Self {
        if angle_rad >= 0.0 { Side::Left } else { Side::Right }
    }

    /// "left" or "right".
    pub fn word(self) -> &'static str {
        match self {
            Side::Left => "left",
            Side::Right => "right",
        }
    }
}

impl Direction {
    /// The class of an angle in radians, positive to the left, within plus and minus pi.
    pub fn of(angle_rad: f64) -> Self {
        let (deg, side) = (angle_rad.abs().to_degrees(), Side::of(angle_rad));
        match deg {
            d if d < 20.0 => Direction::Straight,
            d if d < 60.0 => Direction::Slight(side),
            d if d < 120.0 => Direction::Turn(side),
            d if d <= 150.0 => Direction::Sharp(side),
            _ => Direction::Around,
        }
    }
}

impl PhraseConfig {
    /// The words of a cue; `None` for cues that are sounds only.
    pub fn words(&self, cue: &Cue) -> Option<String> {
        let back = cue.facing == Facing::Backwards;
        Some(match cue.kind {
            CueKind::Start { total_m, left_m, first } => self.start(total_m, left_m, &first, cue.facing),
            CueKind::Away { distance_m, bearing_rad } => self.away(distance_m, bearing_rad),
            CueKind::Resume(First::Turn(a)) => format!("I found my place. {}.", capital(&self.turn(a, back))),
            CueKind::Resume(First::Go(ahead)) => format!("I found my place. {}", self.go(&ahead, back, back)),
            CueKind::Correction(First::Turn(a)) => format!("Correction. {}.", capital(&self.turn(a, back))),
            CueKind::Correction(First::Go(ahead)) => format!("Correction. {}", self.go(&ahead, back, back)),
            CueKind::Approach(ahead) => self.approach(&ahead, back),
            CueKind::TurnNow { turn_rad, stairs } => self.turn_now(turn_rad, stairs, back),
            CueKind::StairsNow(stairs) => format!("Stairs now, {}.", stairs_verb(stairs)),
            CueKind::Rotate(a) if back => format!("Stop. {}.", capital(&self.turn(a, true))),
            CueKind::Rotate(a) => format!("{}.", capital(&self.turn(a, false))),
            CueKind::StopTurning(ahead) => format!("Stop turning. {}", self.go(&ahead, back, back)),
            CueKind::Go { ahead, check } => self.go(&ahead, back, check),
            CueKind::Adjust(a) => format!("{}.", capital(&small_turn(a, back))),
            CueKind::Progress(ahead) => self.progress(&ahead, back),
            CueKind::OffPath { distance_m, bearing_rad, turn_rad, on_spot } => {
                let turn = if on_spot { self.turn(turn_rad, back) } else { small_turn(turn_rad, back) };
                self.off_path(distance_m, bearing_rad, (turn_rad != 0.0).then_some(turn), back)
            }
            CueKind::WrongWay(a) => format!("Wrong way. {}.", capital(&self.turn(a, back))),
            CueKind::Stopped { ahead, on_path: true } => {
                format!("You are on the path. {}", self.go(&ahead, back, false))
            }
            CueKind::Stopped { ahead, on_path: false } => self.go(&ahead, back, false),
            CueKind::CheckBehind => "Stop. Check behind you.".into(),
            CueKind::StepAside(left_m) => {
                format!("Stop. Step back and to your {}.", Side::of(left_m).word())
            }
            CueKind::SlowDown => "Slow down.".into(),
            CueKind::Weak => "Slow down. I cannot see well.".into(),
            CueKind::EndMissed { distance_m, turn_rad } => {
                let at = if self.metric { self.distance(distance_m) } else { "near".into() };
                format!(
                    "Stop. {}, the end is {at}{}.",
                    capital(&self.turn(turn_rad, back)),
                    if self.metric { " away" } else { "" }
                )
            }
            CueKind::Arrived => "Stop. You have arrived. Guidance ends.".into(),
            CueKind::LookRound(a) => format!("Let me find my place. {}.", capital(&self.turn(a, back))),
            CueKind::Stop(reason) => format!("Stop. {}", reason_words(reason)),
            CueKind::Waypoint | CueKind::OnCourse | CueKind::BackOnPath => return None,
        })
    }

    /// A distance in words in the configured unit: rounded to 1 below 10, to 5 from 10, to 10 from 50.
    pub fn distance(&self, metres: f64) -> String {
        let (value, one, many) = match self.unit {
            Unit::Metres => (metres, "metre", "metres"),
            Unit::Feet => (metres / 0.3048, "foot", "feet"),
            Unit::Steps(length) => (metres / length.max(0.1), "step", "steps"),
        };
        let grain = match value {
            v if v >= 50.0 => 10.0,
            v if v >= 10.0 => 5.0,
            _ => 1.0,
        };
        let rounded = ((value / grain).round() * grain).max(1.0) as i64;
        format!("{rounded} {}", if rounded == 1 { one } else { many })
    }

    fn start(&self, total_m: f64, left_m: f64, first: &First, facing: Facing) -> String {
        let joins = total_m - left_m > crate::guide::AT_START_M;
        let mut s = match (self.metric, joins) {
            (true, false) => format!("The route is {}. ", self.distance(total_m)),
            (true, true) => format!("You are on the route, {} to go. ", self.distance(left_m)),
            (false, false) => "Guidance starts. I cannot measure distances. ".into(),
            (false, true) => "You are on the route. I cannot measure distances. ".into(),
        };
        match facing {
            Facing::Home => {}
            Facing::Back => s += "The camera faces behind you. ",
            Facing::Backwards => {
                s += "Caution, you will move backwards. Go slowly and only on flat ground. ";
            }
        }
        let back = facing == Facing::Backwards;
        s += &match first {
            First::Turn(a) => format!("{}.", capital(&self.turn(*a, back))),
            First::Go(ahead) => self.go(ahead, back, back),
        };
        s
    }

    /// The walker is not on the route, and no one has walked between him and it.
    fn away(&self, distance_m: f64, bearing_rad: f64) -> String {
        let place = match Direction::of(bearing_rad) {
            Direction::Straight => "ahead".to_owned(),
            Direction::Around => "behind you".to_owned(),
            Direction::Slight(s) | Direction::Turn(s) | Direction::Sharp(s) => {
                format!("to your {}", s.word())
            }
        };
        let at = if self.metric { format!("{} away, ", self.distance(distance_m)) } else { "away, ".into() };
        format!("The route is {at}{place}. I do not know the ground between. Go there, and I will guide you.")
    }

    /// "turn left", "rotate right", "turn around".
    fn turn(&self, angle_rad: f64, back: bool) -> String {
        let verb = if back { "rotate" } else { "turn" };
        match self.directions {
            DirectionStyle::Words => match Direction::of(angle_rad) {
                Direction::Straight => small_turn(angle_rad, back),
                Direction::Slight(side) => format!("{verb} slightly {}", side.word()),
                Direction::Turn(side) => format!("{verb} {}", side.word()),
                Direction::Sharp(side) => format!("{verb} sharp {}", side.word()),
                Direction::Around => format!("{verb} around"),
            },
            DirectionStyle::Clock => format!("{verb} to {}", clock(angle_rad)),
            DirectionStyle::Degrees => {
                let deg = ((angle_rad.to_degrees().abs() / 10.0).round() * 10.0).max(10.0);
                format!("{verb} {} {deg} degrees", Side::of(angle_rad).word())
            }
        }
    }

    fn next(&self, next: &Next, back: bool) -> String {
        match next {
            Next::Turn { turn_rad, stairs: None } => self.turn(*turn_rad, back),
            Next::Turn { turn_rad, stairs: Some(s) } => {
                format!("{} and {}", self.turn(*turn_rad, back), stairs_verb(*s))
            }
            Next::Stairs(s) => stairs_verb(*s).into(),
            Next::End => "arrive".into(),
        }
    }

    /// ", then in 3 metres turn right" for a turn that follows soon.
    fn then(&self, ahead: &Ahead, back: bool) -> String {
        match &ahead.then {
            Some((d, next)) if self.metric => {
                format!(", then in {} {}", self.distance(*d), self.next(next, back))
            }
            Some((_, next)) => format!(", then soon {}", self.next(next, back)),
            None => String::new(),
        }
    }

    fn go(&self, ahead: &Ahead, back: bool, check: bool) -> String {
        let mut s = String::new();
        if check {
            s += "Check behind you. ";
        }
        // The last few metres after a halt are walked slowly, so that the walker can stop where he is told.
        let last = ahead.next == Next::End && ahead.distance_m < 3.0;
        s += match (back, last) {
            (true, _) => "Move back",
            (false, true) => "Move slowly",
            (false, false) => "Continue",
        };
        if self.metric {
            s += &format!(" {}", self.distance(ahead.distance_m));
        }
        s += &match &ahead.next {
            Next::End => " to the end".into(),
            next => format!(", then {}", self.next(next, back)),
        };
        s + &self.then(ahead, back) + "."
    }

    fn approach(&self, ahead: &Ahead, back: bool) -> String {
        if ahead.next == Next::End {
            let rest = if self.metric { self.distance(ahead.distance_m) } else { "a little".into() };
            return format!("Slow down, {rest} to the end.");
        }
        let lead = match self.metric {
            true => format!("In {}, ", self.distance(ahead.distance_m)),
            false => "Soon, ".into(),
        };
        format!("{lead}{}{}.", self.next(&ahead.next, back), self.then(ahead, back))
    }

    fn turn_now(&self, turn_rad: f64, stairs: Option<Stairs>, back: bool) -> String {
        let halt = if back { "Stop. " } else { "" };
        let now = if back { "" } else { " now" };
        let stairs = stairs.map_or(String::new(), |s| format!(", and {}", stairs_verb(s)));
        format!("{halt}{}{now}{stairs}.", capital(&self.turn(turn_rad, back)))
    }

    fn progress(&self, ahead: &Ahead, back: bool) -> String {
        let left = match self.metric {
            true => format!("{} more", self.distance(ahead.distance_m)),
            false => "On the path".into(),
        };
        match &ahead.next {
            Next::End => format!("{left}, to the end."),
            next => format!("{left}, then {}.", self.next(next, back)),
        }
    }

    fn off_path(&self, distance_m: f64, bearing_rad: f64, turn: Option<String>, back: bool) -> String {
        let at = if self.metric { format!("{} ", self.distance(distance_m)) } else { String::new() };
        let place = match Direction::of(bearing_rad) {
            Direction::Straight => "ahead".to_owned(),
            Direction::Around => "behind you".to_owned(),
            Direction::Slight(s) | Direction::Turn(s) | Direction::Sharp(s) => {
                format!("to your {}", s.word())
            }
        };
        // A walker moving backwards has the course behind him: ahead on the course is behind the chest.
        let place = match (back, Direction::of(bearing_rad)) {
            (true, Direction::Straight) => "behind you".to_owned(),
            (true, Direction::Around) => "in front of you".to_owned(),
            _ => place,
        };
        match turn {
            // What to do comes first: the walker is still moving while this is said.
            Some(turn) if self.metric => format!("Off the path. {}, it is {at}away.", capital(&turn)),
            Some(turn) => format!("Off the path. {}.", capital(&turn)),
            None => format!("Off the path. It is {at}{place}."),
        }
    }
}

/// "9 o'clock"; straight ahead is 12, a quarter to the left is 9.
pub fn clock(angle_rad: f64) -> String {
    let sector = (-angle_rad.to_degrees() / 30.0).round() as i64;
    let hour = match sector.rem_euclid(12) {
        0 => 12,
        h => h,
    };
    format!("{hour} o'clock")
}

/// A correction made without stopping.
fn small_turn(angle_rad: f64, back: bool) -> String {
    let side = Side::of(angle_rad).word();
    if back { format!("rotate {side} a little") } else { format!("bear {side}") }
}

fn stairs_verb(stairs: Stairs) -> &'static str {
    match stairs {
        Stairs::Up => "go upstairs",
        Stairs::Down => "go downstairs",
    }
}

/// Why the walker must stop, in a sentence.
pub fn reason_words(reason: StopReason) -> &'static str {
    match reason {
        StopReason::TrackingLost => "I lost my place.",
        StopReason::PoseStale => "No picture from the camera.",
        StopReason::PicturesLate => "The pictures come too late.",
        StopReason::AgeUnknown => "I do not know how old the pictures are.",
        StopReason::Obstacle => "Something is in the way.",
        StopReason::UnknownGround => "I cannot see the ground ahead.",
        StopReason::ScaleUncertain => {
            "I cannot judge distances here. It helps to turn back and walk backwards, or to let the camera face back."
        }
        StopReason::StageDied => "Part of the guide stopped working.",
    }
}

fn capital(s: &str) -> String {
    let mut chars = s.chars();
    chars.next().map_or(String::new(), |c| c.to_uppercase().collect::<String>() + chars.as_str())
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
        for (deg, text) in
            [(0, "12 o'clock"), (90, "9 o'clock"), (-90, "3 o'clock"), (180, "6 o'clock"), (-25, "1 o'clock")]
        {
            assert_eq!(clock((deg as f64).to_radians()), text);
        }
        let turn = CueKind::TurnNow { turn_rad: 1.6, stairs: None };
        let styled = |directions| PhraseConfig { directions, ..PhraseConfig::default() };
        assert_eq!(words(&styled(DirectionStyle::Clock), turn), "Turn to 9 o'clock now.");
        assert_eq!(words(&styled(DirectionStyle::Degrees), turn), "Turn left 90 degrees now.");
        assert_eq!(words(&PhraseConfig::default(), turn), "Turn left now.");
    }

    #[test]
    fn next_maneuver_is_said_with_the_action() {
        let then = Some((2.6, Next::Turn { turn_rad: -1.5, stairs: Some(Stairs::Up) }));
        let ahead = Ahead { distance_m: 6.1, next: Next::Turn { turn_rad: 0.7, stairs: None }, then };
        assert_eq!(
            words(&PhraseConfig::default(), CueKind::Approach(ahead)),
            "In 6 metres, turn slightly left, then in 3 metres turn right and go upstairs."
        );
    }
}
