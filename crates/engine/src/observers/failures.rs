//! Tells once that a stage failed, or that the map cannot be read.

use super::observer::{DoneFrame, Observer};
use crate::output::{Output, StageEvent};

/// The failures of stages; the first is told.
#[derive(Debug, Default)]
pub(crate) struct Failures {
    is_told: bool,
}

impl Observer for Failures {
    fn done(&mut self, frame: &mut DoneFrame, output: &mut Output) {
        let unreadable =
            || frame.snapshot.read_fault().map(|fault| format!("the map cannot be read: {fault}"));
        let failed = frame.stage_failed.take().or_else(unreadable).filter(|_| !self.is_told);
        self.is_told |= failed.is_some();
        output.events.extend(failed.map(StageEvent::Failed));
    }

    fn failed(&mut self, _why: &str) {
        self.is_told = true;
    }
}
