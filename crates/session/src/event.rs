//! The events of a session for its user interfaces: utterances that start now, and earcons.

use cairn_guide::{Cue, CueKind, Earcon, First, Next, Priority};
use cairn_phrases::Language;
use cairn_sensor::Stamp;
use serde::Serialize;

/// An event to be heard, seen or felt as vibration.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// An utterance starts.
    Said(Said),
    /// An earcon starts.
    Sound(Sound),
}

/// An utterance that starts now.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Said {
    /// Seconds since the session's first packet.
    pub t_s: f64,
    /// Its time in the source's clock.
    #[serde(skip)]
    pub stamp: Stamp,
    /// The text.
    pub text: String,
    /// Its language.
    pub language: Language,
    /// 0 urgent, 1 high, 2 normal, 3 low.
    pub priority: u8,
    /// The current utterance must be interrupted.
    pub interrupts: bool,
    /// Estimated duration in seconds; 0 where nobody waits for it.
    pub duration_s: f64,
    /// The turn that the words ask for, radians, positive to the walker's left.
    pub turn_rad: Option<f64>,
    /// The time of the pose that a direction is based on, in the source's clock; `None` if it is not a direction.
    #[serde(skip)]
    pub pose: Option<Stamp>,
}

impl Said {
    /// Words that are no direction, said at `stamp`, `t_s` after the first packet.
    pub fn plain(text: String, language: Language, priority: Priority, (stamp, t_s): (Stamp, f64)) -> Self {
        Self {
            t_s,
            stamp,
            text,
            language,
            priority: rank(priority),
            interrupts: priority == Priority::Urgent,
            duration_s: 0.0,
            turn_rad: None,
            pose: None,
        }
    }
}

/// A short synthesised sound.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sound {
    /// Seconds since the session's first packet.
    pub t_s: f64,
    /// The sound.
    pub earcon: Earcon,
    /// The direction from which it should be heard, radians, positive to the walker's left, 0 ahead.
    pub bearing_rad: f64,
}

/// A priority as a number, 0 the most urgent.
pub fn rank(priority: Priority) -> u8 {
    match priority {
        Priority::Urgent => 0,
        Priority::High => 1,
        Priority::Normal => 2,
        Priority::Low => 3,
    }
}

/// The name of an earcon, for pages and files.
pub fn earcon_name(earcon: Earcon) -> &'static str {
    match earcon {
        Earcon::OnCourse => "on-course",
        Earcon::OffCourse => "off-course",
        Earcon::Turn => "turn",
        Earcon::Turning => "turning",
        Earcon::Waypoint => "waypoint",
        Earcon::Arrival => "arrival",
        Earcon::Stop => "stop",
    }
}

/// The turn that a cue asks for, radians, positive to the left; `None` where it asks for none.
pub fn turn_of(cue: &Cue) -> Option<f64> {
    use CueKind::*;
    let of_next = |next: Next| match next {
        Next::Turn { turn_rad, .. } => Some(turn_rad),
        _ => None,
    };
    match cue.kind {
        TurnNow { turn_rad, .. } | EndMissed { turn_rad, .. } => Some(turn_rad),
        Rotate(a) | Turning(a) | WrongWay(a) | Adjust(a) | LookRound(a) => Some(a),
        OffPath { turn_rad, bearing_rad, .. } => Some(if turn_rad == 0.0 { bearing_rad } else { turn_rad }),
        Start { first: First::Turn(a), .. }
        | Resume(First::Turn(a))
        | Clear(First::Turn(a))
        | Around(First::Turn(a)) => Some(a),
        Approach(ahead) => of_next(ahead.next),
        Step(step) => Some(step.side().signum() * std::f64::consts::FRAC_PI_2),
        _ => None,
    }
}
