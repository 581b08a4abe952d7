//! How what is said reaches the user: `--say`.

use super::sink::{Ended, Sink, Step};
use crate::failure::Failure;
use crate::interrupt;
use cairn_session::Event;
use cairn_voice::{Espeak, EspeakVoice, NoVoice, SpeechConfig, TextVoice, Voice, VoiceError, WavVoice};
use std::path::{Path, PathBuf};
use std::str::FromStr;

/// How announcements are given.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Say {
    /// Lines of text.
    Text,
    /// Spoken aloud.
    Speech,
    /// Spoken into a WAV file.
    Wav(PathBuf),
    /// Not at all.
    None,
}

/// A word names no way to give directions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("write text, speech, wav:FILE or none")]
pub struct SayError;

impl FromStr for Say {
    type Err = SayError;

    fn from_str(text: &str) -> Result<Self, SayError> {
        Ok(match text {
            "text" => Self::Text,
            "speech" => Self::Speech,
            "none" => Self::None,
            other => match other.strip_prefix("wav:").filter(|path| !path.is_empty()) {
                Some(path) => Self::Wav(path.into()),
                None => return Err(SayError),
            },
        })
    }
}

impl Say {
    /// Checks that the speech program is there, where it is needed.
    ///
    /// # Errors
    /// When it is missing.
    pub fn check(&self, config: SpeechConfig) -> Result<(), Failure> {
        match self {
            Self::Speech | Self::Wav(_) => Espeak::find(config).map(drop).map_err(fail),
            Self::Text | Self::None => Ok(()),
        }
    }

    /// The voice, with the checked file of wav:FILE; if the result is JSON, announcements as text go to stderr.
    ///
    /// # Errors
    /// When the speech program is missing or the WAV file cannot be created.
    pub fn voice(&self, config: SpeechConfig, wav: Option<&Path>, json: bool) -> Result<Spoken, Failure> {
        let espeak = || Espeak::find(config).map_err(fail);
        let voice: Box<dyn Voice> = match self {
            Self::Text if json => Box::new(TextVoice::new(std::io::stderr())),
            Self::Text => Box::new(TextVoice::new(std::io::stdout())),
            Self::Speech => Box::new(EspeakVoice::new(espeak()?)),
            Self::Wav(path) => Box::new(WavVoice::create(wav.unwrap_or(path), espeak()?).map_err(fail)?),
            Self::None => Box::new(NoVoice),
        };
        Ok(Spoken { voice, aloud: matches!(self, Self::Speech) })
    }
}

/// What the walker hears.
pub struct Spoken {
    voice: Box<dyn Voice>,
    aloud: bool,
}

impl Sink for Spoken {
    fn event(&mut self, event: &Event) {
        match event {
            Event::Said(said) => {
                self.voice.set_language(said.language);
                self.voice.say(&said.text, said.t_s, said.interrupts);
            }
            Event::Sound(s) => self.voice.sound(s.earcon, s.bearing_rad, s.t_s),
        }
    }

    fn step(&mut self, step: &mut Step) {
        self.voice.pass(step.t_s);
    }

    /// Waits until the last announcement has been given, unless a signal ended the run and it is given aloud.
    fn end(mut self: Box<Self>, _: &mut Ended) -> Result<(), Failure> {
        match self.aloud && interrupt::requested() {
            true => Ok(()),
            false => self.voice.end().map_err(fail),
        }
    }
}

fn fail(e: VoiceError) -> Failure {
    Failure::new("voice", e.why, e.cure)
}
