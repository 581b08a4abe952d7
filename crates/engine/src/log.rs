//! The result of every frame, kept so that the whole trajectory can follow the map.

use cairn_sensor::Stamp;
use cairn_tracking::{AnchoredPose, Odometry, State};

/// The result of one frame.
#[derive(Clone, Copy, Debug)]
pub struct Logged {
    /// Time of the frame.
    pub stamp: Stamp,
    /// The state of tracking.
    pub state: State,
    /// The pose as estimated at the time.
    pub anchored: Option<AnchoredPose>,
    /// The odometry at the time.
    pub odometry: Option<Odometry>,
    /// Whether its lengths were metres at the time.
    pub metric: bool,
    /// Whether the unit of length rested on anything at the time (see [`crate::Scale::supported`]).
    pub scale_supported: bool,
}

/// All frames so far.
#[derive(Clone, Debug, Default)]
pub struct Log {
    frames: Vec<Logged>,
}

impl Log {
    pub(crate) fn push(&mut self, frame: Logged) {
        self.frames.push(frame);
    }

    /// Sets the pose of an earlier frame that was found later (the first of a pair). A frame that was given a pose keeps it:
    /// in a turn, the frames up to the new map belong to the map before.
    pub(crate) fn amend(&mut self, stamp: Stamp, anchored: AnchoredPose) {
        let frame = self.frames.iter_mut().rev().find(|f| f.stamp == stamp);
        if let Some(frame) = frame.filter(|f| f.anchored.is_none()) {
            frame.anchored = Some(anchored);
            frame.state = State::Tracking;
        }
    }

    /// All frames in order.
    pub fn frames(&self) -> &[Logged] {
        &self.frames
    }

    /// Frames that have a pose.
    pub fn tracked(&self) -> usize {
        self.frames.iter().filter(|f| f.anchored.is_some()).count()
    }
}
