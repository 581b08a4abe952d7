//! Which feature of one image is which of another: only features that passed the same node are compared
//! (the direct index of Galvez-Lopez and Tardos 2012, section III-A).

use super::Bag;
use crate::{Descriptor, best_two};

/// When two features are taken for one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NodeMatchConfig {
    /// Bits that may differ.
    pub max_distance: u32,
    /// The nearest must differ in less than this share of the bits of the second nearest.
    pub ratio: f64,
}

impl Default for NodeMatchConfig {
    fn default() -> Self {
        Self { max_distance: 60, ratio: 0.8 }
    }
}

/// One image: its bag and the descriptors that it was made of.
pub type Seen<'a> = (&'a Bag, &'a [Descriptor]);

/// Pairs of features, `[first, second]`, rising by the first, each feature at most once. Only features that the two
/// filters let pass take part. Bags of different vocabularies give nonsense, but no panic.
pub fn match_through_nodes(
    first: Seen,
    second: Seen,
    config: &NodeMatchConfig,
    allow_first: impl Fn(usize) -> bool,
    allow_second: impl Fn(usize) -> bool,
) -> Vec<[usize; 2]> {
    // For each feature of the second the nearest of the first that chose it: (distance, feature).
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
            let alone = f64::from(best.distance) < config.ratio * f64::from(best.second);
            let Some(slot) = taken.get_mut(best.index as usize) else { continue };
            if best.distance <= config.max_distance && alone && slot.is_none_or(|s| (best.distance, i) < s) {
                *slot = Some((best.distance, i));
            }
        }
    }
    let mut pairs: Vec<[usize; 2]> =
        taken.iter().enumerate().filter_map(|(j, t)| t.map(|(_, i)| [i, j])).collect();
    pairs.sort_unstable();
    pairs
}
