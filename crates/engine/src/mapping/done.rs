//! What mapping and closing report back.

use crate::output::{StageEvent, Timings};
use cairn_atlas::KeyFrameId;
use cairn_inertial::Attempt;
use cairn_mapping::{ScaleCheck, ScaleVerdict, Verdict};

/// The work that mapping and closing have finished since they were last polled.
#[derive(Clone, Debug, Default)]
pub(crate) struct Done {
    /// Milliseconds of each key frame in mapping.
    pub ms: Vec<f64>,
    /// Milliseconds of each key frame in closing, and of each adjustment of a whole map.
    pub close_ms: Vec<f64>,
    /// Verdicts of closing.
    pub verdicts: Vec<Verdict>,
    /// The last attempt to initialise gravity, scale and biases.
    pub attempt: Option<Attempt>,
    /// The last check of a metric scale; a correction stays until it is polled.
    pub scale_check: Option<ScaleCheck>,
    /// Why a stage failed, if one did.
    pub stage_failed: Option<String>,
}

impl Done {
    /// Events, a failure aside, and the times of the stages.
    pub fn report(self) -> (Vec<StageEvent>, Timings) {
        let initialising = self.attempt.map(|attempt| StageEvent::Attempt(Box::new(attempt))).into_iter();
        let checking = self.scale_check.map(StageEvent::ScaleCheck);
        let events = initialising.chain(checking).chain(self.verdicts.into_iter().map(StageEvent::Verdict));
        (events.collect(), Timings { map_ms: self.ms, close_ms: self.close_ms, ..Timings::default() })
    }

    pub(super) fn take(&mut self, other: Done) {
        self.ms.extend(other.ms);
        self.close_ms.extend(other.close_ms);
        self.verdicts.extend(other.verdicts);
        self.attempt = other.attempt.or(self.attempt.take());
        self.check(other.scale_check);
        self.stage_failed = self.stage_failed.take().or(other.stage_failed);
    }

    /// Takes a result of mapping; returns its key frame.
    pub(super) fn taken(&mut self, taken: Taken) -> Option<KeyFrameId> {
        self.attempt = taken.attempt.or(self.attempt.take());
        self.check(taken.scale_check);
        taken.key_frame
    }

    fn check(&mut self, newer: Option<ScaleCheck>) {
        let corrected = |c: &ScaleCheck| c.verdict == ScaleVerdict::Corrected;
        if !self.scale_check.as_ref().is_some_and(corrected) || newer.as_ref().is_some_and(corrected) {
            self.scale_check = newer.or(self.scale_check);
        }
    }
}

/// What mapping made of a request.
#[derive(Default)]
pub(super) struct Taken {
    pub key_frame: Option<KeyFrameId>,
    pub attempt: Option<Attempt>,
    pub scale_check: Option<ScaleCheck>,
}
