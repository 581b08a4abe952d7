//! What happened when in a run: states of tracking, growth of the map, loops, merges, new maps. The report draws it.

use cairn_atlas::Snapshot;
use cairn_engine::{Joined, Output, State, StatusEvent, Verdict};
use cairn_sensor::Stamp;

/// Seconds between two samples of the size of the map.
const SAMPLE_S: f64 = 0.5;

/// How a frame was tracked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tracking {
    /// No map yet.
    Starting,
    /// By landmarks.
    Tracked,
    /// Bridged by the IMU.
    Coasting,
    /// The orientation alone.
    Rotation,
    /// No pose.
    Lost,
}

impl Tracking {
    /// Of an engine's state.
    pub fn of(state: &State) -> Self {
        match state {
            State::Starting { .. } => Self::Starting,
            State::Tracking => Self::Tracked,
            State::Coasting { .. } => Self::Coasting,
            State::RotationOnly { .. } => Self::Rotation,
            State::Lost { .. } => Self::Lost,
        }
    }

    /// The name in the legend.
    pub fn name(self) -> &'static str {
        match self {
            Self::Starting => "no map yet",
            Self::Tracked => "tracked",
            Self::Coasting => "carried without features",
            Self::Rotation => "rotation only",
            Self::Lost => "lost",
        }
    }
}

/// A stretch of frames tracked in one way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stretch {
    pub tracking: Tracking,
    pub from: Stamp,
    /// The first frame after it, or its own last one.
    pub to: Stamp,
}

/// A loop that was closed, or two maps that were merged.
#[derive(Clone, Debug, PartialEq)]
pub struct Join {
    pub at: Stamp,
    pub merge: bool,
    /// The newer key frame, and the earlier one whose place was recognised.
    pub key_frames: [cairn_atlas::KeyFrameId; 2],
    pub inliers: usize,
    /// How far the newer one was moved: in units of the map, and radians.
    pub moved: f64,
    pub moved_rad: f64,
}

/// A map that was begun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapStart {
    pub at: Stamp,
    pub map: usize,
}

/// Everything that is drawn over time.
#[derive(Clone, Debug, Default)]
pub struct History {
    pub stretches: Vec<Stretch>,
    /// Time, key frames, landmarks.
    pub growth: Vec<(Stamp, usize, usize)>,
    pub joins: Vec<Join>,
    pub starts: Vec<MapStart>,
}

impl History {
    /// Adds a frame.
    pub fn frame(&mut self, done: &Output) {
        let (tracking, at) = (Tracking::of(&done.state), done.stamp);
        match self.stretches.last_mut() {
            Some(last) => {
                last.to = at;
                if last.tracking != tracking {
                    self.stretches.push(Stretch { tracking, from: at, to: at });
                }
            }
            None => self.stretches.push(Stretch { tracking, from: at, to: at }),
        }
        self.joins(at, done.verdicts());
    }

    /// Adds the accepted ones of these verdicts.
    pub fn joins<'v>(&mut self, at: Stamp, verdicts: impl Iterator<Item = &'v Verdict>) {
        for v in verdicts {
            let Ok(accepted) = &v.result else { continue };
            self.joins.push(Join {
                at,
                merge: matches!(accepted.joined, Joined::Merge { .. }),
                key_frames: [v.key_frame, v.candidate],
                inliers: accepted.inliers,
                moved: accepted.off,
                moved_rad: accepted.off_rad,
            });
        }
    }

    /// Adds the events of a status.
    pub fn events(&mut self, at: Stamp, events: &[StatusEvent]) {
        for event in events {
            if let StatusEvent::MapCreated { map, .. } = event {
                self.starts.push(MapStart { at, map: *map });
            }
        }
    }

    /// Whether the size of the map is to be sampled at this time.
    pub fn wants_size(&self, at: Stamp) -> bool {
        self.growth.last().is_none_or(|(last, ..)| at - *last >= SAMPLE_S)
    }

    /// Adds the size of the map.
    pub fn size(&mut self, at: Stamp, snapshot: &Snapshot) {
        self.growth.push((at, snapshot.key_frame_count(), snapshot.landmark_count()));
    }

    /// How a frame was tracked.
    pub fn tracking_at(&self, at: Stamp) -> Option<Tracking> {
        let after = self.stretches.partition_point(|s| s.from <= at);
        self.stretches.get(after.checked_sub(1)?).map(|s| s.tracking)
    }

    /// Seconds in this state.
    pub fn seconds(&self, tracking: Tracking) -> f64 {
        self.stretches.iter().filter(|s| s.tracking == tracking).map(|s| s.to - s.from).sum()
    }
}
