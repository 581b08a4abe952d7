//! Matching by look alone, where nothing is known of where to search.

use crate::{Descriptor, Frame, best_two_of, consistent_rotation};
use std::collections::BTreeSet;

/// A point as it looked before.
#[derive(Clone, Copy, Debug)]
pub struct DescriptorQuery<'a, T> {
    /// What it is.
    pub item: T,
    /// Its descriptor.
    pub descriptor: &'a Descriptor,
    /// Its orientation, radians.
    pub angle: f32,
}

/// The features of a frame that look like earlier points: at most `bits` apart, and at most `ratio` times as far as the
/// second nearest feature. One feature for each point and the other way round, and only those that turned as most did.
/// Features rise.
pub fn match_descriptors<'a, T: Copy + Ord>(
    looks: impl Iterator<Item = DescriptorQuery<'a, T>>,
    frame: &Frame,
    bits: u32,
    ratio: f64,
) -> Vec<(usize, T)> {
    let mut owner: Vec<Option<(T, u32, f32)>> = vec![None; frame.len()];
    for look in looks {
        let best = best_two_of(look.descriptor, &frame.descriptors);
        if best.distance > bits || f64::from(best.distance) > ratio * f64::from(best.second) {
            continue;
        }
        let feature = best.index as usize;
        let slot = &mut owner[feature];
        if slot.is_none_or(|(_, distance, _)| best.distance < distance) {
            *slot = Some((look.item, best.distance, look.angle - frame.angle[feature]));
        }
    }
    let turned = owner.iter().enumerate().filter_map(|(i, o)| o.map(|(item, _, turn)| ((i, item), turn)));
    let mut matches = consistent_rotation(turned.collect());
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
    fn the_nearer_look_wins_and_what_is_ambiguous_goes() {
        let mut frame = Frame::default();
        // Two features that look the same, and five that are each like one thing only, far apart from each other.
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
        let looks = [
            (7, other, 0.5),
            (1, near, 0.5),
            (2, descriptor(0x00), 0.5),
            (3, descriptor(0xff), 0.5),
            (4, descriptor(0x33), 0.5),
            (4, descriptor(0xcc), 0.5),
            (5, descriptor(0xaa), 2.5),
        ];
        let many = || {
            looks.iter().map(|(item, d, angle)| DescriptorQuery { item: *item, descriptor: d, angle: *angle })
        };
        assert_eq!(match_descriptors(many(), &frame, 50, 0.8), [(2, 2), (3, 3), (4, 4), (6, 5)]);
        assert_eq!(match_descriptors(many(), &Frame::default(), 50, 0.8), []);
    }
}
