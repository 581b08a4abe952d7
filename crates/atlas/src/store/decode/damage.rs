//! What is done about a part that is damaged: it is refused, or left out with a note.

use crate::store::error::StoreError;

/// What happens when a part is damaged.
pub(crate) enum Damage<'a> {
    /// It is an error.
    Refuse,
    /// What can be done without is left out, with a note of what is lost.
    LeaveOut(&'a mut Vec<String>),
}

impl Damage<'_> {
    /// The result, or what stands for it where the part is damaged.
    pub(super) fn or<T>(
        &mut self,
        result: Result<T, StoreError>,
        loss: &str,
        instead: impl FnOnce() -> T,
    ) -> Result<T, StoreError> {
        match (result, self) {
            (Err(e), Self::LeaveOut(lost)) => {
                lost.push(format!("{e}: {loss}"));
                Ok(instead())
            }
            (result, _) => result,
        }
    }

    pub(super) fn count(&self) -> usize {
        match self {
            Self::Refuse => 0,
            Self::LeaveOut(lost) => lost.len(),
        }
    }
}
