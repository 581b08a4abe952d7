//! Matching by descriptor alone, without a predicted position (relocalisation, place recognition).

use crate::{Descriptor, Frame, best_two_of, consistent_rotation};
use std::collections::BTreeSet;

/// A descriptor to match, with what it belongs to.
#[derive(Clone, Copy, Debug)]
pub struct DescriptorQuery<'a, T> {
    /// Caller's identifier, returned with the match.
    pub item: T,
    /// The descriptor.
    pub descriptor: &'a Descriptor,
    /// Orientation of its feature in radians.
    pub angle: f32,
}

/// Matches queries to the features of a frame by exhaustive search: the Hamming distance is at most `bits` and at most
/// `ratio` times that of the second nearest feature. Matches are one to one and pass [`consistent_rotation`]; returned
/// as (feature index, item), sorted by feature.
pub fn match_descriptors<'a, T: Copy + Ord>(
    queries: impl Iterator<Item = DescriptorQuery<'a, T>>,
    frame: &Frame,
    bits: u32,
    ratio: f64,
) -> Vec<(usize, T)> {
    let mut owner: Vec<Option<(T, u32, f32)>> = vec![None; frame.len()];
    for query in queries {
        let best = best_two_of(query.descriptor, &frame.descriptors);
        if best.distance > bits || f64::from(best.distance) > ratio * f64::from(best.second) {
            continue;
        }
        let feature = best.index as usize;
        let slot = &mut owner[feature];
        if slot.is_none_or(|(_, distance, _)| best.distance < distance) {
            *slot = Some((query.item, best.distance, query.angle - frame.angle[feature]));
        }
    }
    let rotated = owner.iter().enumerate().filter_map(|(i, o)| o.map(|(item, _, turn)| ((i, item), turn)));
    let mut matches = consistent_rotation(rotated.collect());
    let mut taken = BTreeSet::new();
    matches.retain(|(_, item)| taken.insert(*item));
    matches
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptor(byte: u8) -> Descriptor {
        [byte; 32]
    }

    #[test]
    fn nearest_query_wins_and_ambiguous_matches_are_dropped() {
        let mut frame = Frame::default();
        // Two features with the same descriptor, and five with mutually distant ones.
        for byte in [0x0f, 0x0f, 0x00, 0xff, 0x33, 0xcc, 0xaa] {
            frame.px.push([0.0, 0.0]);
            frame.raw.push([0.0, 0.0]);
            frame.angle.push(0.5);
            frame.descriptors.push(descriptor(byte));
        }
        let mut near = descriptor(0x00);
        near[0] = 0x07;
        let mut other = descriptor(0x0f);
        other[0] = 0x00;
        let queries = [
            (7, other, 0.5),
            (1, near, 0.5),
            (2, descriptor(0x00), 0.5),
            (3, descriptor(0xff), 0.5),
            (4, descriptor(0x33), 0.5),
            (4, descriptor(0xcc), 0.5),
            (5, descriptor(0xaa), 2.5),
        ];
        let all = || {
            queries.iter().map(|(item, d, angle)| DescriptorQuery {
                item: *item,
                descriptor: d,
                angle: *angle,
            })
        };
        assert_eq!(match_descriptors(all(), &frame, 50, 0.8), [(2, 2), (3, 3), (4, 4), (6, 5)]);
        assert_eq!(match_descriptors(all(), &Frame::default(), 50, 0.8), []);
    }
}
