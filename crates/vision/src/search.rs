//! Guided search: matching a known descriptor around its predicted position in a frame.

use crate::{Descriptor, Frame, hamming};

/// What to search for and where.
#[derive(Clone, Copy, Debug)]
pub struct Target<'a> {
    /// Predicted rectified pixel.
    pub pixel: [f32; 2],
    /// Predicted x in the right image; NaN if unknown.
    pub right_x: f32,
    /// Half side of the search window in pixels.
    pub radius: f32,
    /// Allowed pyramid levels, first and last.
    pub octaves: [u8; 2],
    /// Descriptor to match.
    pub descriptor: &'a Descriptor,
}

/// The best match and the second best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Found {
    /// Index of the feature.
    pub feature: usize,
    /// Hamming distance in bits.
    pub distance: u32,
    /// Hamming distance of the second nearest in bits; `u32::MAX` without one.
    pub second: u32,
    /// Level of the second nearest.
    pub second_octave: u8,
}

/// The feature of `frame` in the search window with the smallest Hamming distance to the target, among those that
/// `allowed` accepts.
pub fn search(frame: &Frame, target: &Target, allowed: impl Fn(usize) -> bool) -> Option<Found> {
    let mut best: Option<Found> = None;
    let [u, v] = target.pixel;
    frame.near_in(u, v, target.radius, target.octaves, |i| {
        if !allowed(i) {
            return;
        }
        // A measured right x must lie within the same radius (NaN passes).
        if (frame.right_x[i] - target.right_x).abs() > target.radius {
            return;
        }
        let distance = hamming(target.descriptor, &frame.descriptors[i]);
        match &mut best {
            None => best = Some(Found { feature: i, distance, second: u32::MAX, second_octave: 0 }),
            Some(b) if distance < b.distance => {
                *b =
                    Found { feature: i, distance, second: b.distance, second_octave: frame.octave[b.feature] }
            }
            Some(b) if distance < b.second => (b.second, b.second_octave) = (distance, frame.octave[i]),
            _ => {}
        }
    });
    best
}

/// Rotation consistency check (ORB-SLAM): keeps the matches in the three fullest of 30 histogram bins of
/// `(target angle - feature angle)`. Matches are `(item, angle difference in radians)`.
pub fn consistent_rotation<T>(matches: Vec<(T, f32)>) -> Vec<T> {
    const BINS: usize = 30;
    let bin = |angle: f32| {
        let turn = angle.rem_euclid(std::f32::consts::TAU) / std::f32::consts::TAU;
        (turn * BINS as f32 + 0.5) as usize % BINS
    };
    let mut counts = [0usize; BINS];
    for (_, angle) in &matches {
        counts[bin(*angle)] += 1;
    }
    let mut order: Vec<usize> = (0..BINS).collect();
    order.sort_by_key(|b| std::cmp::Reverse(counts[*b]));
    // A bin is used only if it has at least a tenth of the matches of the fullest one.
    let keep: Vec<usize> =
        order[..3].iter().copied().filter(|b| counts[*b] * 10 >= counts[order[0]]).collect();
    matches.into_iter().filter(|(_, angle)| keep.contains(&bin(*angle))).map(|(item, _)| item).collect()
}
