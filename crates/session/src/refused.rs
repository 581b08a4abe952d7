//! What a session answers to a command that it cannot carry out.

use cairn_phrases::{Arg, Language};

/// Why a command was not carried out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{words}")]
pub struct Refused {
    /// The sentence in the catalogue, for programs: the same in every language.
    pub id: &'static str,
    /// What the walker hears, in his language.
    pub words: String,
}

impl Refused {
    /// By a sentence of the catalogue and the values in it.
    pub fn new(language: Language, id: &'static str, values: &[(&str, Arg<'_>)]) -> Self {
        Self { id, words: language.say(id, values) }
    }
}
