//! How Cairn speaks to this walker: settings that the command line, the page and lines of text change alike.

use cairn_guide::{DirectionStyle, Unit};
use cairn_phrases::{Language, UnknownLanguage};

/// A setting and its value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Setting {
    /// The language of what is said.
    Language(Language),
    /// The unit of distances.
    Unit(Unit),
    /// The form of directions.
    Directions(DirectionStyle),
    /// The speed of the voice, words a minute: how long an utterance is taken to last.
    WordsPerMinute(f64),
}

/// Length of a step in metres, where the walker has not set it: at 1.7 m of height and a calm pace adults take steps of
/// 0.6 to 0.75 m; with a cane rather less than more.
pub const STEP_M: f64 = 0.65;
/// The range of the length of a step, metres.
pub const STEPS_M: [f64; 2] = [0.2, 1.2];
/// The range of the speed of a voice, words a minute.
pub const WORDS_PER_MINUTE: [f64; 2] = [80.0, 400.0];

/// Why words are not a setting; the text is for the user.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SettingError {
    /// There is no such setting.
    #[error("\"set {0}\" is not a setting; write {FORMS}")]
    Unknown(String),
    /// There are no sentences in the language.
    #[error(transparent)]
    Language(#[from] UnknownLanguage),
    /// Not a number of its range.
    #[error("\"{text}\" is not a number from {low} to {high}")]
    Number {
        /// What was written.
        text: String,
        /// The smallest that is taken.
        low: f64,
        /// The greatest.
        high: f64,
    },
}

impl Setting {
    /// Parses "language de", "unit steps 0.65", "directions clock" or "speed 200".
    ///
    /// # Errors
    /// What is wrong with the words.
    pub fn parse(words: &[&str]) -> Result<Self, SettingError> {
        Ok(match words {
            ["language", code] => Self::Language(code.parse()?),
            ["unit", "metres"] => Self::Unit(Unit::Metres),
            ["unit", "feet"] => Self::Unit(Unit::Feet),
            ["unit", "steps"] => Self::Unit(Unit::Steps(STEP_M)),
            ["unit", "steps", metres] => Self::Unit(Unit::Steps(number(metres, STEPS_M)?)),
            ["directions", "words"] => Self::Directions(DirectionStyle::Words),
            ["directions", "clock"] => Self::Directions(DirectionStyle::Clock),
            ["directions", "degrees"] => Self::Directions(DirectionStyle::Degrees),
            ["speed", words] => Self::WordsPerMinute(number(words, WORDS_PER_MINUTE)?),
            _ => return Err(SettingError::Unknown(words.join(" "))),
        })
    }
}

/// The settings as they are written.
pub(crate) const FORMS: &str = "set language en|es|de, set unit metres|feet|steps [METRES], set directions \
                                words|clock|degrees, set speed WORDS_PER_MINUTE";

fn number(text: &str, [low, high]: [f64; 2]) -> Result<f64, SettingError> {
    match text.parse::<f64>() {
        Ok(v) if (low..=high).contains(&v) => Ok(v),
        _ => Err(SettingError::Number { text: text.to_owned(), low, high }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_parsed_within_their_ranges() {
        let parse = |line: &str| Setting::parse(&line.split(' ').collect::<Vec<_>>());
        assert_eq!(parse("language de"), Ok(Setting::Language(Language::German)));
        assert_eq!(parse("unit steps 0.7"), Ok(Setting::Unit(Unit::Steps(0.7))));
        assert_eq!(parse("unit steps"), Ok(Setting::Unit(Unit::Steps(STEP_M))));
        assert_eq!(parse("directions clock"), Ok(Setting::Directions(DirectionStyle::Clock)));
        assert_eq!(parse("speed 400"), Ok(Setting::WordsPerMinute(400.0)));
        for wrong in ["", "language fr", "unit miles", "unit steps 0", "unit steps NaN", "speed 401", "speed"]
        {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
