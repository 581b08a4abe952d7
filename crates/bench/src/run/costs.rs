//! What a run costs.

use cairn_engine::Output;
use cairn_eval::Percentiles;
use serde::{Deserialize, Serialize};

/// Milliseconds of each frame, or of each key frame.
#[derive(Clone, Debug, Default)]
pub struct Costs {
    pub step_ms: Vec<f64>,
    pub track_ms: Vec<f64>,
    pub map_ms: Vec<f64>,
    pub tracked: usize,
}

impl Costs {
    pub fn add(&mut self, out: &Output) {
        self.step_ms.push(out.timings.step_ms());
        self.track_ms.push(out.timings.track_ms);
        self.map_ms.extend(&out.timings.map_ms);
        self.tracked += usize::from(out.pose.is_some());
    }
}

/// Times of a run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Times {
    /// Decoded image to pose, milliseconds.
    pub step_ms: Percentiles,
    /// The part from features to pose.
    pub track_ms: Percentiles,
    /// Mapping of a key frame, milliseconds.
    pub map_ms: Percentiles,
}

impl Times {
    pub fn of(costs: &Costs) -> Self {
        let of = |ms: &[f64]| Percentiles::of(ms).unwrap_or_default();
        Self { step_ms: of(&costs.step_ms), track_ms: of(&costs.track_ms), map_ms: of(&costs.map_ms) }
    }
}

/// Costs of a stretch of a run.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Part {
    /// Which one, from 1.
    pub number: usize,
    /// Number of packets.
    pub frames: usize,
    /// Packets with a live pose.
    pub tracked: usize,
    /// Key frames processed by mapping.
    pub mapped: usize,
    /// Times.
    pub times: Times,
    /// Resident memory at its end, megabytes.
    pub resident_mb: Option<f64>,
    /// Key frames in the map at its end.
    pub key_frames: usize,
    /// Landmarks in the map at its end.
    pub landmarks: usize,
}
