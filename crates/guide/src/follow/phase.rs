//! What the walker is doing, and what is remembered of it from step to step.

use crate::facing::Heading;
use crate::matcher::Match;
use cairn_sensor::Stamp;

/// What the walker is doing.
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
#[derive(Clone, Copy)]
pub(crate) struct Now {
    pub stamp: Stamp,
    pub walker: Heading,
    pub at: Match,
    pub speed: f64,
}

/// A turn in progress.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turning {
    /// When the direction was given.
    pub said: Stamp,
    /// The heading that they had when the words had been heard.
    pub from: f64,
    /// The walker began to turn.
    pub began: bool,
    /// "Stop turning" was said, together with what comes next.
    pub stop_said: bool,
    /// "Stop" was said instead: he stands when the turn has ended.
    pub held: bool,
    /// Since when the walker has not been turning.
    pub still_since: Option<Stamp>,
    /// The walker was moving when the direction was given and will continue by himself.
    pub moving: bool,
}

impl Turning {
    /// Whether the walker continues by himself after the turn.
    pub fn goes_on(&self) -> bool {
        (self.moving || self.stop_said) && !self.held
    }

    /// A turn whose direction is given now; `moving` when the walker will continue by himself after it.
    pub fn new(now: &Now, moving: bool) -> Self {
        Self {
            said: now.stamp,
            from: now.walker.heading,
            began: false,
            stop_said: false,
            held: false,
            still_since: None,
            moving,
        }
    }
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
}
