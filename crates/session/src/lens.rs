//! What is known of the lens of a camera that nobody calibrated, as far as the walker is told of it: a wrong focal length makes
//! distances wrong by as much.

/// What is known of the lens, and what the walker has heard of it.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct LensReport {
    pub known: Option<LensKnowledge>,
    reported: Option<LensKnowledge>,
}

impl LensReport {
    /// What is known and has not been said yet; it counts as said from now on.
    pub fn news(&mut self) -> Option<LensKnowledge> {
        let news = self.known.filter(|known| self.reported != Some(*known));
        self.reported = news.or(self.reported);
        news
    }
}

/// What is known of the lens.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LensKnowledge {
    /// The images are read with a guess.
    Guessed,
    /// It was found, or another than was known, and is used from the next session on: the routes of this one hang on a map that
    /// was made without it.
    FoundForLater,
    /// It was found, and is used from now on.
    Found,
}

impl LensKnowledge {
    /// The id of the sentence.
    pub(crate) fn id(self) -> &'static str {
        match self {
            Self::Guessed => "walk-lens-unknown",
            Self::FoundForLater => "walk-lens-known-later",
            Self::Found => "walk-lens-known",
        }
    }
}
