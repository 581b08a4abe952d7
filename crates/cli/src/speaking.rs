//! The options for how Cairn speaks to a walker, the same for every command that guides.

use crate::number::between;
use cairn_guide::{AnnouncerConfig, DirectionStyle, PhraseConfig, Unit, WORDS_PER_MINUTE};
use cairn_phrases::Language;
use cairn_session::{STEP_M, STEPS_M, WORDS_PER_MINUTE as SPEEDS};

/// The heading of these options in the help.
pub const HEADING: &str = "Announcements";

/// The keys and lines of commands, for the help.
pub fn keys() -> String {
    format!("Keys: {}.", cairn_session::help(Language::English))
}

/// How Cairn speaks.
#[derive(Clone, Debug, clap::Args)]
pub struct Speaking {
    /// The language of announcements: en, es or de.
    #[arg(help_heading = HEADING, long, default_value = "en", value_name = "CODE")]
    pub language: Language,
    /// The unit of spoken distances.
    #[arg(help_heading = HEADING, long, value_enum, default_value = "metres")]
    pub unit: UnitArgument,
    /// Length of a step of this walker in centimetres, for --unit steps.
    #[arg(help_heading = HEADING, long, value_name = "CM", default_value_t = 100.0 * STEP_M,
        value_parser = between(100.0 * STEPS_M[0], 100.0 * STEPS_M[1]))]
    pub step: f64,
    /// How directions are announced.
    #[arg(help_heading = HEADING, long, value_enum, default_value = "words")]
    pub directions: DirectionsArgument,
    /// Speed of the speech.
    #[arg(help_heading = HEADING, long, value_name = "N", value_parser = between(SPEEDS[0], SPEEDS[1]))]
    pub words_per_minute: Option<f64>,
}

impl Speaking {
    /// The sentences.
    pub fn phrases(&self) -> PhraseConfig {
        let unit = match self.unit {
            UnitArgument::Metres => Unit::Metres,
            UnitArgument::Feet => Unit::Feet,
            UnitArgument::Steps => Unit::Steps(0.01 * self.step),
        };
        PhraseConfig { language: self.language, unit, directions: self.directions.style(), metric: true }
    }

    /// The queue of announcements.
    pub fn announcer(&self) -> AnnouncerConfig {
        let rate = self.words_per_minute.map_or(1.0, |words| words / WORDS_PER_MINUTE);
        AnnouncerConfig { rate, ..AnnouncerConfig::default() }
    }
}

/// The unit of distances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum UnitArgument {
    /// Metres.
    Metres,
    /// Feet.
    Feet,
    /// Steps, by default of 65 cm.
    Steps,
}

/// How directions are announced.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum DirectionsArgument {
    /// "Turn left."
    Words,
    /// "Turn to 9 o'clock."
    Clock,
    /// "Turn left 90 degrees."
    Degrees,
}

impl DirectionsArgument {
    /// The type that phrases use.
    pub fn style(self) -> DirectionStyle {
        match self {
            Self::Words => DirectionStyle::Words,
            Self::Clock => DirectionStyle::Clock,
            Self::Degrees => DirectionStyle::Degrees,
        }
    }
}
