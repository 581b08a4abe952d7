//! AVX2 version of [`super::orientation`], identical results.
#![allow(unsafe_code)]

use super::orientation_scalar::{MASK, RADIUS};
use cairn_sensor::GrayImage;
use std::arch::x86_64::*;

/// Distance of each of the 32 pixels from the centre column.
static WEIGHT: [i8; 32] = {
    let mut out = [0; 32];
    let mut i = 0;
    while i < 32 {
        out[i] = i as i8 - 16;
        i += 1;
    }
    out
};

/// First moments of the disc around a pixel at least 16 from the edge.
pub(super) fn moments(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    let (w, h) = (image.width(), image.height());
    assert!(x >= 16 && y >= 16 && x + 16 <= w && y + 16 <= h && is_x86_feature_detected!("avx2"));
    // SAFETY: AVX2 is available; columns x - 16 to x + 15 of rows y - 15 to y + 15 are inside.
    unsafe { moments_avx2(image, x, y) }
}

/// # Safety
/// AVX2 must be available, and the patch inside the image as [`moments`] asserts.
#[target_feature(enable = "avx2")]
unsafe fn moments_avx2(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    let zero = _mm256_setzero_si256();
    let ones = _mm256_set1_epi16(1);
    // SAFETY: the patch is inside the image; the tables are 32 bytes long.
    let (row, mask, weight) = unsafe {
        let first = image.data().as_ptr().add((y - RADIUS) * image.width() + x - 16);
        (
            move |i: usize| _mm256_loadu_si256(first.add(i * image.width()) as *const __m256i),
            |dy: usize| _mm256_loadu_si256(MASK[dy].as_ptr() as *const __m256i),
            _mm256_loadu_si256(WEIGHT.as_ptr() as *const __m256i),
        )
    };
    let middle = _mm256_and_si256(row(RADIUS), mask(0));
    let mut m10 = _mm256_madd_epi16(_mm256_maddubs_epi16(middle, weight), ones);
    let mut m01 = zero;
    for dy in 1..=RADIUS {
        let above = _mm256_and_si256(row(RADIUS - dy), mask(dy));
        let below = _mm256_and_si256(row(RADIUS + dy), mask(dy));
        let across =
            _mm256_add_epi16(_mm256_maddubs_epi16(above, weight), _mm256_maddubs_epi16(below, weight));
        m10 = _mm256_add_epi32(m10, _mm256_madd_epi16(across, ones));
        let down = _mm256_sub_epi64(_mm256_sad_epu8(below, zero), _mm256_sad_epu8(above, zero));
        m01 = _mm256_add_epi64(m01, _mm256_mul_epi32(down, _mm256_set1_epi64x(dy as i64)));
    }
    let (mut across, mut down) = ([0i32; 8], [0i64; 4]);
    // SAFETY: both arrays are 32 bytes long.
    unsafe {
        _mm256_storeu_si256(across.as_mut_ptr() as *mut __m256i, m10);
        _mm256_storeu_si256(down.as_mut_ptr() as *mut __m256i, m01);
    }
    [across.iter().sum(), down.iter().sum::<i64>() as i32]
}
