//! Says where the unit of length of a pose is not to be relied on.

use super::observer::{DoneFrame, Observer};
use crate::output::{Output, StageEvent};
use crate::scale::is_adrift;
use cairn_mapping::ScaleVerdict;

/// Doubts about the scale.
#[derive(Debug)]
pub(crate) struct ScaleReport {
    /// Whether the camera has depth: then no motion sensor carries the unit of length.
    has_depth: bool,
    /// Whether the IMU contradicts the scale of the map at present.
    is_contradicted: bool,
}

impl ScaleReport {
    pub fn new(has_depth: bool) -> Self {
        Self { has_depth, is_contradicted: false }
    }
}

impl Observer for ScaleReport {
    fn done(&mut self, _frame: &mut DoneFrame, output: &mut Output) {
        if let Some(check) = output.events.iter().find_map(StageEvent::scale_check) {
            self.is_contradicted = check.verdict == ScaleVerdict::Contradicted;
        }
        let is_doubtful = self.is_contradicted || (!self.has_depth && is_adrift(&output.state));
        if let Some(pose) = &mut output.pose {
            pose.scale.supported &= !is_doubtful;
        }
    }
}
