//! Portable version of the searches of [`super::hamming`], and their result.

use crate::Descriptor;

/// The nearest candidate and the distance of the second nearest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BestTwo {
    /// Index of the nearest (the first of equals); `u32::MAX` without candidates.
    pub index: u32,
    /// Its distance in bits; `u32::MAX` without candidates.
    pub distance: u32,
    /// Distance of the second nearest in bits; `u32::MAX` with fewer than two candidates.
    pub second: u32,
}

impl BestTwo {
    /// No candidate yet.
    pub const NONE: Self = Self { index: u32::MAX, distance: u32::MAX, second: u32::MAX };

    #[inline(always)]
    fn update(&mut self, index: u32, distance: u32) {
        if distance < self.distance {
            self.second = self.distance;
            (self.index, self.distance) = (index, distance);
        } else if distance < self.second {
            self.second = distance;
        }
    }
}

/// The portable search; also compiled with more instructions enabled in `hamming_x86`.
#[inline(always)]
pub(super) fn nearest(
    query: &Descriptor,
    among: &[Descriptor],
    candidates: impl Iterator<Item = u32>,
) -> BestTwo {
    let mut best = BestTwo::NONE;
    for i in candidates {
        if let Some(d) = among.get(i as usize) {
            best.update(i, distance(query, d));
        }
    }
    best
}

#[inline(always)]
pub(super) fn distance(a: &Descriptor, b: &Descriptor) -> u32 {
    let word = |d: &Descriptor, k: usize| {
        let mut w = [0u8; 8];
        w.copy_from_slice(&d[k * 8..k * 8 + 8]);
        u64::from_le_bytes(w)
    };
    (0..4).map(|k| (word(a, k) ^ word(b, k)).count_ones()).sum()
}
