#![doc = include_str!("../README.md")]

mod earcon;
mod espeak;
mod text;
mod wav;

pub use earcon::{Channel, earcon};
pub use espeak::{Espeak, EspeakVoice, SpeechConfig};
pub use text::{NoVoice, TextVoice};
pub use wav::WavVoice;

use cairn_guide::Earcon;
use cairn_phrases::Language;

/// Why a voice cannot speak, with a remedy.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}; {cure}")]
pub struct VoiceError {
    /// What is wrong.
    pub why: String,
    /// What the user can do.
    pub cure: String,
}

/// An output for speech. Times are seconds since the start of the walk and never decrease.
pub trait Voice: Send {
    /// The language of what is said from now on.
    fn set_language(&mut self, _: Language) {}
    /// Starts saying words now; `interrupts` breaks off the present utterance.
    fn say(&mut self, text: &str, t_s: f64, interrupts: bool);
    /// Starts an earcon now, from `bearing_rad` (positive: the walker's left).
    fn sound(&mut self, earcon: Earcon, bearing_rad: f64, t_s: f64);
    /// Called as time passes: detects failures and writes what is due.
    fn pass(&mut self, t_s: f64);
    /// Finishes: waits for the last words, completes files.
    ///
    /// # Errors
    /// When something could not be said or written.
    fn end(&mut self) -> Result<(), VoiceError>;
}
