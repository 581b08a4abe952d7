//! What becomes of the surfaces of a run, as its supervisor knows it.

use crate::message::Failure;
use std::time::Instant;

/// The surfaces of a run.
#[derive(Debug)]
pub(crate) struct Surfaces {
    /// `None` while they grow with the map; then that they are written, or there are none and why. Also where none were asked for.
    ended: Option<Result<(), Failure>>,
    /// When their process died, until the next one has begun.
    died: Option<Instant>,
}

impl Surfaces {
    /// Of a run that makes some, or none.
    pub fn new(are_made: bool) -> Self {
        Self { ended: (!are_made).then_some(Ok(())), died: None }
    }

    /// Whether there is more to come.
    pub fn grow(&self) -> bool {
        self.ended.is_none()
    }

    /// They are written, or will not be; what was said first counts.
    pub fn end(&mut self, how: Result<(), Failure>) {
        self.ended.get_or_insert(how);
    }

    /// Their process has died, and the next one is to come.
    pub fn process_died(&mut self) {
        self.died.get_or_insert_with(Instant::now);
    }

    /// Their process has begun; seconds since the one before died, if it did.
    pub fn process_began(&mut self) -> Option<f64> {
        self.died.take().map(|died| died.elapsed().as_secs_f64())
    }

    /// How they ended.
    pub fn outcome(self) -> Result<(), Failure> {
        self.ended.unwrap_or(Ok(()))
    }
}
