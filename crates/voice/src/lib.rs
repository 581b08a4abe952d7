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

/// Why a voice can not speak, with what to do about it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{why}; {cure}")]
pub struct VoiceError {
    /// What is wrong.
    pub why: String,
    /// What the user can do.
    pub cure: String,
}

/// Something that speaks. Times are seconds of the walk; they never go back.
pub trait Voice: Send {
    /// Begins words now; `interrupts` breaks off what is being said.
    fn say(&mut self, text: &str, t_s: f64, interrupts: bool);
    /// Begins a short sound now, from `bearing_rad` (positive: the walker's left).
    fn sound(&mut self, earcon: Earcon, bearing_rad: f64, t_s: f64);
    /// Time passes: what died is noticed here, and what is due is written.
    fn pass(&mut self, t_s: f64);
    /// Ends: waits for the last words, completes files.
    ///
    /// # Errors
    /// When something could not be said or written.
    fn end(&mut self) -> Result<(), VoiceError>;
}
