//! AVX2 version of [`super::descriptor`]: eight tests at a time, bit-identical.
#![allow(unsafe_code)]

use super::BORDER;
use super::pattern::PATTERN;
use crate::Descriptor;
use std::arch::x86_64::*;

/// Points of the pattern in groups of eight tests: x and y of the first points, then of the second.
static POINTS: [[[i16; 16]; 2]; 32] = points();

const fn points() -> [[[i16; 16]; 2]; 32] {
    let mut out = [[[0; 16]; 2]; 32];
    let mut i = 0;
    while i < 256 {
        let mut k = 0;
        while k < 4 {
            out[i / 8][k / 2][2 * (i % 8) + k % 2] = PATTERN[i][k] as i16;
            k += 1;
        }
        i += 1;
    }
    out
}

/// See [`super::descriptor::describe`].
pub(super) fn describe(data: &[u8], stride: usize, centre: usize, direction: [i16; 2]) -> Descriptor {
    let reach = (BORDER - 1) * stride + BORDER - 1;
    assert!(stride <= i16::MAX as usize && is_x86_feature_detected!("avx2"));
    assert!(centre >= reach && centre + reach + 4 <= data.len());
    // SAFETY: AVX2 is available; rotated points lie at most 15 from the centre in x and y, so every read of four bytes
    // begins at centre - reach or later and ends at centre + reach + 4 or earlier.
    unsafe { describe_avx2(data, stride, centre, direction) }
}

/// # Safety
/// AVX2 must be available, and the patch inside the data as [`describe`] asserts.
#[target_feature(enable = "avx2")]
unsafe fn describe_avx2(data: &[u8], stride: usize, centre: usize, [c, s]: [i16; 2]) -> Descriptor {
    let two = |low: i16, high: i16| _mm256_set1_epi32((low as u16 as i32) | (high as i32) << 16);
    let (to_x, to_y, to_offset) = (two(c, -s), two(s, c), two(1, stride as i16));
    let round = _mm256_set1_epi32(8192);
    let byte = _mm256_set1_epi32(255);
    // SAFETY: centre is inside the data.
    let base = unsafe { data.as_ptr().add(centre) as *const i32 };
    let mut out = [0u8; 32];
    for (out, points) in out.iter_mut().zip(&POINTS) {
        let value = |points: &[i16; 16]| {
            // SAFETY: the table's row is 32 bytes long.
            let p = unsafe { _mm256_loadu_si256(points.as_ptr() as *const __m256i) };
            let x = _mm256_srai_epi32(_mm256_add_epi32(_mm256_madd_epi16(p, to_x), round), 14);
            // y goes into the upper 16 bits: 16 up for the position and 14 down for the scale is 2 up.
            let y = _mm256_slli_epi32(_mm256_add_epi32(_mm256_madd_epi16(p, to_y), round), 2);
            let offset = _mm256_madd_epi16(_mm256_blend_epi16(x, y, 0b1010_1010), to_offset);
            // SAFETY: see `describe`.
            _mm256_and_si256(unsafe { _mm256_i32gather_epi32::<1>(base, offset) }, byte)
        };
        let darker = _mm256_cmpgt_epi32(value(&points[1]), value(&points[0]));
        *out = _mm256_movemask_ps(_mm256_castsi256_ps(darker)) as u8;
    }
    out
}
