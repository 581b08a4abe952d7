//! Hamming distances between descriptors, and the two nearest of many.

use super::hamming_scalar::{distance, nearest};
use crate::Descriptor;

pub use super::hamming_scalar::BestTwo;

/// Number of bits in which two descriptors differ, 0 to 256.
#[inline]
pub fn hamming(a: &Descriptor, b: &Descriptor) -> u32 {
    #[cfg(target_arch = "x86_64")]
    if let Some(distance) = super::hamming_x86::distance(a, b) {
        return distance;
    }
    distance(a, b)
}

/// The two nearest of `among[i]` for each `i` in `candidates`, in the order given; indices out of range are skipped.
pub fn best_two(query: &Descriptor, among: &[Descriptor], candidates: &[u32]) -> BestTwo {
    #[cfg(target_arch = "x86_64")]
    if let Some(best) = super::hamming_x86::nearest(query, among, candidates.len(), |k| candidates[k]) {
        return best;
    }
    nearest(query, among, candidates.iter().copied())
}

/// The two nearest of all of `among`.
pub fn best_two_of(query: &Descriptor, among: &[Descriptor]) -> BestTwo {
    #[cfg(target_arch = "x86_64")]
    if let Some(best) = super::hamming_x86::nearest(query, among, among.len(), |k| k as u32) {
        return best;
    }
    nearest(query, among, 0..among.len() as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn descriptors(n: usize) -> Vec<Descriptor> {
        let mut random = cairn_random::Random::new(7);
        (0..n).map(|_| std::array::from_fn(|_| random.below(256) as u8)).collect()
    }

    fn plain(a: &Descriptor, b: &Descriptor) -> u32 {
        a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum()
    }

    #[test]
    fn hamming_counts_differing_bits() {
        assert_eq!(hamming(&[0; 32], &[255; 32]), 256);
        for pair in descriptors(100).windows(2) {
            assert_eq!(hamming(&pair[0], &pair[1]), plain(&pair[0], &pair[1]));
            assert_eq!(hamming(&pair[0], &pair[0]), 0);
        }
    }

    #[test]
    fn best_two_matches_a_sorted_search() {
        let among = descriptors(301);
        for query in descriptors(350).iter().skip(280) {
            for n in [0, 1, 2, 3, 7, 8, 9, 100, 301] {
                let mut sorted: Vec<(u32, u32)> =
                    (0..n).map(|i| (plain(query, &among[i as usize]), i)).collect();
                sorted.sort();
                let at = |k: usize| sorted.get(k).map_or(u32::MAX, |s| s.0);
                let expected = BestTwo {
                    index: sorted.first().map_or(u32::MAX, |s| s.1),
                    distance: at(0),
                    second: at(1),
                };
                let candidates: Vec<u32> = (0..n).collect();
                assert_eq!(best_two(query, &among, &candidates), expected);
                assert_eq!(best_two_of(query, &among[..n as usize]), expected);
                assert_eq!(nearest(query, &among, 0..n), expected);
            }
        }
    }

    #[test]
    fn first_of_equal_candidates_wins() {
        let mut among = descriptors(40);
        among[7] = among[30];
        among[12] = among[30];
        let order: Vec<u32> = (0..40).rev().collect();
        let expected = BestTwo { index: 30, distance: 0, second: 0 };
        assert_eq!(best_two(&among[30], &among, &order), expected);
        assert_eq!(best_two_of(&among[30], &among), BestTwo { index: 7, ..expected });
    }

    #[test]
    fn all_kernels_agree_with_the_scalar_one() {
        #[cfg(target_arch = "x86_64")]
        {
            let among = descriptors(203);
            for (k, kernel) in super::super::hamming_x86::kernels().into_iter().enumerate() {
                for (q, query) in descriptors(300).iter().enumerate().skip(200) {
                    // Some indices are out of range.
                    let list: Vec<u32> = (0..q as u32 * 3).map(|i| i * 91 % 230).collect();
                    for n in [0, 1, 2, 3, 4, 5, 17, 63, list.len()] {
                        let found = kernel(query, &among, &list[..n]);
                        assert_eq!(
                            found,
                            nearest(query, &among, list[..n].iter().copied()),
                            "kernel {k}, {n}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn indices_out_of_range_are_skipped() {
        let among = descriptors(3);
        let best = best_two(&among[1], &among, &[9, 1, u32::MAX, 3]);
        assert_eq!(best, BestTwo { index: 1, distance: 0, second: u32::MAX });
    }
}
