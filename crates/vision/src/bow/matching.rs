//! Feature matching between two images through the direct index: only features below the same node of the vocabulary
//! tree are compared (Galvez-Lopez and Tardos 2012, section III-A).

use super::BagOfWords;
use crate::{Descriptor, best_two};

/// Thresholds of [`match_through_nodes`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeMatchConfig {
    /// Maximum Hamming distance in bits.
    pub max_distance: u32,
    /// Ratio test: the nearest distance must be below this fraction of the second nearest.
    pub ratio: f64,
}

impl Default for NodeMatchConfig {
    fn default() -> Self {
        Self { max_distance: 60, ratio: 0.8 }
    }
}

/// One image: its bag and the descriptors it was computed from.
pub type BowImage<'a> = (&'a BagOfWords, &'a [Descriptor]);

/// Matched features, `[first, second]`, sorted by the first; each feature occurs at most once. Only features accepted
/// by the two filters take part. Bags of different vocabularies give meaningless matches, but no panic.
pub fn match_through_nodes(
    first: BowImage,
    second: BowImage,
    config: &NodeMatchConfig,
    allow_first: impl Fn(usize) -> bool,
    allow_second: impl Fn(usize) -> bool,
) -> Vec<[usize; 2]> {
    // For each feature of the second image, the nearest feature of the first that chose it: (distance, feature).
    let mut taken: Vec<Option<(u32, usize)>> = vec![None; second.1.len()];
    let mut candidates: Vec<u32> = Vec::new();
    let mut rest = second.0.nodes();
    for group in first.0.nodes().chunk_by(|a, b| a.0 == b.0) {
        let node = group[0].0;
        rest = &rest[rest.partition_point(|(n, _)| *n < node)..];
        let same = &rest[..rest.partition_point(|(n, _)| *n == node)];
        candidates.clear();
        candidates.extend(same.iter().map(|(_, j)| u32::from(*j)).filter(|j| allow_second(*j as usize)));
        if candidates.is_empty() {
            continue;
        }
        for i in group.iter().map(|(_, i)| usize::from(*i)).filter(|i| allow_first(*i)) {
            let Some(descriptor) = first.1.get(i) else { continue };
            let best = best_two(descriptor, second.1, &candidates);
            let distinct = f64::from(best.distance) < config.ratio * f64::from(best.second);
            let Some(slot) = taken.get_mut(best.index as usize) else { continue };
            if best.distance <= config.max_distance && distinct && slot.is_none_or(|s| (best.distance, i) < s)
            {
                *slot = Some((best.distance, i));
            }
        }
    }
    let mut pairs: Vec<[usize; 2]> =
        taken.iter().enumerate().filter_map(|(j, t)| t.map(|(_, i)| [i, j])).collect();
    pairs.sort_unstable();
    pairs
}
