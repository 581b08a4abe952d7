//! One step in the present phase.

use super::{Follower, Now, Phase};
use crate::cue::CueKind;

impl Follower {
    /// The cue that is due; none before guidance begins, and after it has ended.
    pub(crate) fn step(&mut self, now: &Now) -> Option<CueKind> {
        self.leave_behind(now);
        match self.phase.clone() {
            Phase::Begin | Phase::Done => None,
            Phase::Turning(turning) => self.turning(turning, now),
            Phase::Moving => self.moving(now),
            Phase::Checking { since } => self.checking(since, now),
            Phase::SteppingAside { since } => self.stepping_aside(since, now),
        }
    }
}
