//! Versions of [`super::hamming`] for x86-64 with `popcnt` or the AVX-512 vector popcount; identical results.
#![allow(unsafe_code)]

use super::hamming_scalar::{self as scalar, BestTwo};
use crate::Descriptor;
use std::arch::x86_64::*;

/// The two nearest of `among[candidate(k)]` for `k` below `n`; `None` where this machine has neither instruction.
#[inline]
pub(super) fn nearest(
    query: &Descriptor,
    among: &[Descriptor],
    n: usize,
    candidate: impl Fn(usize) -> u32,
) -> Option<BestTwo> {
    if has_vector_popcount() {
        // SAFETY: the features were detected.
        return Some(unsafe { nearest_avx512(query, among, n, candidate) });
    }
    if is_x86_feature_detected!("popcnt") {
        // SAFETY: the feature was detected.
        return Some(unsafe { nearest_popcnt(query, among, n, candidate) });
    }
    None
}

/// Number of bits that differ; `None` where this machine has no `popcnt`.
#[inline]
pub(super) fn distance(a: &Descriptor, b: &Descriptor) -> Option<u32> {
    // SAFETY: the feature was detected by the condition.
    is_x86_feature_detected!("popcnt").then(|| unsafe { distance_popcnt(a, b) })
}

/// # Safety
/// `popcnt` must be available.
#[target_feature(enable = "popcnt")]
unsafe fn distance_popcnt(a: &Descriptor, b: &Descriptor) -> u32 {
    scalar::distance(a, b)
}

fn has_vector_popcount() -> bool {
    is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("avx512vpopcntdq")
}

/// A search kernel.
#[cfg(test)]
pub(super) type Kernel = fn(&Descriptor, &[Descriptor], &[u32]) -> BestTwo;

/// All kernels that this machine can run, for tests.
#[cfg(test)]
pub(super) fn kernels() -> Vec<Kernel> {
    let mut out: Vec<Kernel> = vec![];
    if is_x86_feature_detected!("popcnt") {
        // SAFETY: the feature was detected.
        out.push(|query, among, list| unsafe { nearest_popcnt(query, among, list.len(), |k| list[k]) });
    }
    if has_vector_popcount() {
        // SAFETY: the features were detected.
        out.push(|query, among, list| unsafe { nearest_avx512(query, among, list.len(), |k| list[k]) });
    }
    out
}

/// # Safety
/// `popcnt` must be available.
#[target_feature(enable = "popcnt")]
unsafe fn nearest_popcnt(
    query: &Descriptor,
    among: &[Descriptor],
    n: usize,
    candidate: impl Fn(usize) -> u32,
) -> BestTwo {
    scalar::nearest(query, among, (0..n).map(candidate))
}

/// Four candidates at a time; a lane holds `distance << 32 | k`, so the minimum is the nearest, and the first of
/// equals.
///
/// # Safety
/// AVX-512 F, VL and VPOPCNTDQ must be available.
#[target_feature(enable = "avx2,avx512f,avx512vl,avx512vpopcntdq")]
unsafe fn nearest_avx512(
    query: &Descriptor,
    among: &[Descriptor],
    n: usize,
    candidate: impl Fn(usize) -> u32,
) -> BestTwo {
    // SAFETY: a descriptor is 32 bytes long.
    let load = |d: &Descriptor| unsafe { _mm256_loadu_si256(d.as_ptr() as *const __m256i) };
    let query = load(query);
    let none = _mm256_set1_epi64x(-1);
    let (mut first, mut second) = (none, none);
    let mut position = _mm256_setr_epi64x(0, 1, 2, 3);
    for k in (0..n).step_by(4) {
        // Lanes without a candidate are set to all ones.
        let mut outside = 0u8;
        let counts: [__m256i; 4] = std::array::from_fn(|i| {
            let d = (k + i < n).then(|| among.get(candidate(k + i) as usize)).flatten();
            match d {
                Some(d) => _mm256_popcnt_epi64(_mm256_xor_si256(query, load(d))),
                None => {
                    outside |= 1 << i;
                    query
                }
            }
        });
        // Sum of the four 64-bit words of each descriptor.
        let add = |a, b| _mm256_add_epi64(_mm256_unpacklo_epi64(a, b), _mm256_unpackhi_epi64(a, b));
        let (low, high) = (add(counts[0], counts[1]), add(counts[2], counts[3]));
        let swapped = _mm256_permute2x128_si256::<0x21>(low, high);
        let sums = _mm256_add_epi64(_mm256_blend_epi32::<0xf0>(low, high), swapped);
        let keys = _mm256_or_si256(_mm256_slli_epi64::<32>(sums), position);
        let keys = _mm256_mask_mov_epi64(keys, outside, none);
        position = _mm256_add_epi64(position, _mm256_set1_epi64x(4));
        second = _mm256_min_epu64(second, _mm256_max_epu64(first, keys));
        first = _mm256_min_epu64(first, keys);
    }
    finish(first, second, candidate)
}

/// The two smallest of eight keys.
#[target_feature(enable = "avx2")]
fn finish(first: __m256i, second: __m256i, candidate: impl Fn(usize) -> u32) -> BestTwo {
    let mut keys = [0u64; 8];
    // SAFETY: the array is 64 bytes long.
    unsafe {
        _mm256_storeu_si256(keys.as_mut_ptr() as *mut __m256i, first);
        _mm256_storeu_si256(keys.as_mut_ptr().add(4) as *mut __m256i, second);
    }
    keys.sort_unstable();
    let distance = |key: u64| if key == u64::MAX { u32::MAX } else { (key >> 32) as u32 };
    let index = if keys[0] == u64::MAX { u32::MAX } else { candidate(keys[0] as u32 as usize) };
    BestTwo { index, distance: distance(keys[0]), second: distance(keys[1]) }
}
