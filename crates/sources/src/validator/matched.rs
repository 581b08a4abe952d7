//! Features of two pictures that show one point: near each other's descriptor, and nearer than to the next best.

use cairn_vision::{Features, best_two_of};

/// Descriptors of one point differ by so many bits at most, and by so much of the next best.
const MAX_HAMMING: u32 = 50;
const RATIO: f64 = 0.8;

/// Where they are in the two pictures.
pub(super) fn matched(a: &Features, b: &Features) -> impl Iterator<Item = [[f32; 2]; 2]> {
    (0..a.len()).filter_map(|i| {
        let best = best_two_of(&a.descriptors[i], &b.descriptors);
        let is_sure =
            best.distance <= MAX_HAMMING && f64::from(best.distance) < RATIO * f64::from(best.second);
        is_sure.then(|| [a.raw[i], b.raw[best.index as usize]])
    })
}
