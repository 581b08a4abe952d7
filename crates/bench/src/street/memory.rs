//! Bytes of a map by structure, and place queries on it.

use crate::memory::resident_mb;
use cairn_atlas::{Landmark, Observation, Snapshot};
use std::mem::size_of;
use std::time::Instant;

/// Bytes for each key frame by structure; what the allocator adds is in the resident figure only.
#[derive(Clone, Debug, Default, serde::Serialize)]
pub struct Bytes {
    /// Share of the key frames whose features are in memory, not on the disk.
    pub in_memory: f64,
    /// Pixels, levels, angles, depths, and the pixels in the raw image.
    pub features: f64,
    /// Descriptors of the features.
    pub descriptors: f64,
    /// Words and the direct index, where they are in memory.
    pub words: f64,
    /// The landmark that each feature shows.
    pub shown: f64,
    /// Covisible key frames.
    pub covisible: f64,
    /// Landmarks without their observations.
    pub landmarks: f64,
    /// Observations of the landmarks.
    pub observations: f64,
}

impl Bytes {
    /// Of a map, on average over its key frames.
    pub fn of(map: &Snapshot) -> Self {
        let mut sum = Self::default();
        for k in map.key_frames() {
            if let Some(f) = k.frame.in_memory() {
                sum.in_memory += 1.0;
                sum.features += (8 * (f.raw.capacity() + f.px.capacity())
                    + f.octave.capacity()
                    + 4 * (f.angle.capacity() + f.depth.capacity() + f.right_x.capacity()))
                    as f64;
                sum.descriptors += (32 * f.descriptors.capacity()) as f64;
            }
            if let Some(bag) = k.bag.in_memory() {
                sum.words += (8 * bag.words().len() + 8 * bag.nodes().len()) as f64;
            }
            sum.shown += (4 * k.landmarks.capacity()) as f64;
            sum.covisible += (8 * k.covisible.capacity()) as f64;
        }
        for l in map.landmarks() {
            // With the two counts of its shared pointer.
            sum.landmarks += (size_of::<Landmark>() + 16) as f64;
            sum.observations += (size_of::<Observation>() * l.observations.capacity()) as f64;
        }
        let count = map.key_frame_count().max(1) as f64;
        for part in [
            &mut sum.in_memory,
            &mut sum.features,
            &mut sum.descriptors,
            &mut sum.words,
            &mut sum.shown,
            &mut sum.covisible,
            &mut sum.landmarks,
            &mut sum.observations,
        ] {
            *part /= count;
        }
        sum
    }
}

/// Resident bytes more than before, for each key frame.
pub fn resident_for_each(before_mb: Option<f64>, key_frames: usize) -> Option<f64> {
    Some((resident_mb()? - before_mb?) * 1e6 / key_frames.max(1) as f64)
}

/// Milliseconds of place queries with the words of key frames spread over the map.
pub fn queries_ms(map: &Snapshot, count: usize) -> Vec<f64> {
    let every = (map.key_frame_count() / count.max(1)).max(1);
    let asked = map.key_frames().step_by(every).map(|k| {
        let start = Instant::now();
        let found = map.similar_key_frames(&k.bag, 3, usize::MAX, &[], |id| id != k.id);
        std::hint::black_box(found);
        start.elapsed().as_secs_f64() * 1e3
    });
    asked.collect()
}
