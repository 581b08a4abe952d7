//! What became of every frame, kept so that the whole trajectory follows the map.

use cairn_atlas::Map;
use cairn_geometry::Se3;
use cairn_sensor::Stamp;
use cairn_tracking::{Placed, State};

/// One frame.
#[derive(Clone, Copy, Debug)]
pub struct Logged {
    /// Time of the frame.
    pub stamp: Stamp,
    /// Where tracking stood.
    pub state: State,
    /// The pose as it was given then.
    pub placed: Option<Placed>,
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

    /// Gives an earlier frame a pose that was found later (the first of a pair).
    pub(crate) fn amend(&mut self, stamp: Stamp, placed: Placed) {
        if let Some(frame) = self.frames.iter_mut().rev().find(|f| f.stamp == stamp) {
            frame.placed = Some(placed);
            frame.state = State::Tracking;
        }
    }

    /// All frames in order.
    pub fn frames(&self) -> &[Logged] {
        &self.frames
    }

    /// Frames that have a pose.
    pub fn tracked(&self) -> usize {
        self.frames.iter().filter(|f| f.placed.is_some()).count()
    }

    /// Where the eye was in every tracked frame, as the map sees it now (`world_from_eye`).
    pub fn corrected(&self, map: &Map) -> Vec<(Stamp, Se3)> {
        let place = |f: &Logged| {
            let p = f.placed?;
            Some((f.stamp, map.stand(p.reference, &p.reference_from_eye)?))
        };
        self.frames.iter().filter_map(place).collect()
    }

    /// The same as it was given at the time.
    pub fn live(&self) -> Vec<(Stamp, Se3)> {
        self.frames.iter().filter_map(|f| Some((f.stamp, f.placed?.world_from_eye))).collect()
    }
}
