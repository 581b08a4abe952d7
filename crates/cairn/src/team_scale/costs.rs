//! What one robot pays: the inputs of the model.

use crate::merge::GROWN;
use serde::Serialize;

/// `at_zero + each * n`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Straight {
    /// The constant part.
    pub at_zero: f64,
    /// For each.
    pub each: f64,
}

impl Straight {
    /// Through two measurements, `(n, value)`; neither part is below zero.
    pub fn through((n, a): (f64, f64), (m, b): (f64, f64)) -> Self {
        let each = ((b - a) / (m - n)).max(0.0);
        Self { at_zero: (a - each * n).max(0.0), each }
    }

    /// Its value.
    pub fn at(&self, n: f64) -> f64 {
        self.at_zero + self.each * n
    }
}

/// `factor * n^exponent`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Power {
    /// Its value at one.
    pub factor: f64,
    /// How it grows.
    pub exponent: f64,
}

impl Power {
    /// Through two measurements, `(n, value)`, that are above zero; it grows at least in proportion to `n`.
    pub fn through((n, a): (f64, f64), (m, b): (f64, f64)) -> Self {
        let exponent = ((b / a).ln() / (m / n).ln()).max(1.0);
        Self { factor: b / m.powf(exponent), exponent }
    }

    /// Its value.
    pub fn at(&self, n: f64) -> f64 {
        self.factor * n.max(0.0).powf(self.exponent)
    }
}

/// What was measured on this machine, of two short simulated walks. Times are of one thread.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Costs {
    /// Key frames of the two walks, and seconds that these took in the world.
    pub key_frames: usize,
    /// See there.
    pub walked_s: f64,
    /// Words of a key frame, in the mean.
    pub words: f64,
    /// Bytes of the words of a key frame on the network.
    pub words_bytes: f64,
    /// Bytes of a key frame of a map as it is sent, landmarks and all, said once.
    pub map_bytes: f64,
    /// Bytes of all pieces, over those of the last save said once: what local mapping moved, and what became of key frames that went,
    /// is sent as well.
    pub sent_again: f64,
    /// Bytes that a key frame of a map takes in memory; `None` where the system does not tell.
    pub memory_bytes: Option<f64>,
    /// Bytes of what a robot says every second to each other one, by the robots of the team.
    pub have_bytes: Straight,
    /// Seconds of a query for similar places, by the key frames of the index.
    pub query_s: Straight,
    /// Seconds to compare the words of two key frames of two robots.
    pub compare_s: f64,
    /// Seconds to read a map and to join it with another one, for each of its key frames, without adjusting anything.
    pub join_s: f64,
    /// Seconds to adjust around the places where they meet, for each of its key frames.
    pub around_s: f64,
    /// Seconds to adjust a map as a whole, for each of its key frames.
    pub adjust_s: f64,
    /// Key frames up to which a map is adjusted as a whole.
    pub adjusted_as_a_whole: usize,
    /// Earlier key frames to which one has an edge in the pose graph that is relaxed.
    pub edges: f64,
    /// Seconds to relax the pose graph of a map, by its key frames.
    pub relax_s: Power,
}

impl Costs {
    /// Seconds to merge maps with `each` key frames into one: each joins those before it, is compared and relaxed with them. Up to a certain
    /// size all is adjusted as a whole whenever it has grown by half and at the end, beyond it at each join around the seams.
    pub fn merge_s(&self, maps: usize, each: f64) -> f64 {
        let mut adjusted = 1.0;
        let joins = (2..=maps).map(|k| {
            let size = each * k as f64;
            let whole = size <= self.adjusted_as_a_whole as f64;
            let now = k == maps || k as f64 >= GROWN * adjusted;
            let adjust = match (whole, now) {
                (true, true) => {
                    adjusted = k as f64;
                    size * self.adjust_s
                }
                (true, false) => 0.0,
                (false, _) => each * self.around_s,
            };
            each * self.join_s + self.relax_s.at(size) + adjust
        });
        joins.sum()
    }

    /// Key frames that a robot makes in a second of walking.
    pub fn key_frames_per_s(&self) -> f64 {
        self.key_frames as f64 / self.walked_s
    }
}
