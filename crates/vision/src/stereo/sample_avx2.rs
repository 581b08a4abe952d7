//! AVX2 version of [`super::sample`]: eight samples at a time with gathered loads, bit-identical.
#![allow(unsafe_code)]

use super::lattice::Lattice;
use super::patch::{AREA, PADDED, Patch, RADIUS, SIDE};
use cairn_sensor::GrayImage;
use std::arch::x86_64::*;

/// Column and row of each sample relative to the centre; zero in the padding.
static OFFSETS: [[i32; PADDED]; 2] = {
    let mut out = [[0; PADDED]; 2];
    let mut k = 0;
    while k < AREA {
        out[0][k] = (k % SIDE) as i32 - RADIUS;
        out[1][k] = (k / SIDE) as i32 - RADIUS;
        k += 1;
    }
    out
};

/// Samples a lattice that [`Lattice::new`] has checked to be inside the image.
pub(super) fn sample(image: &GrayImage, lattice: &Lattice, out: &mut Patch) {
    let [a, b, c, d] = lattice.step;
    let reach_x = RADIUS * (a.abs() + b.abs());
    let reach_y = RADIUS * (c.abs() + d.abs());
    assert!(
        is_x86_feature_detected!("avx2")
            && lattice.x >= reach_x
            && lattice.y >= reach_y
            && ((lattice.x + reach_x) >> 16) + 4 <= image.width() as i32
            && ((lattice.y + reach_y) >> 16) + 2 <= image.height() as i32
    );
    // SAFETY: AVX2 is available; each sample is at least four pixels from the right edge and two from the lower one.
    unsafe { sample_avx2(image, lattice, out) }
}

/// # Safety
/// AVX2 must be available, and the lattice inside the image as [`sample`] asserts.
#[target_feature(enable = "avx2")]
unsafe fn sample_avx2(image: &GrayImage, lattice: &Lattice, out: &mut Patch) {
    let [a, b, c, d] = lattice.step.map(|v| _mm256_set1_epi32(v));
    let (x, y) = (_mm256_set1_epi32(lattice.x), _mm256_set1_epi32(lattice.y));
    let stride = _mm256_set1_epi32(image.width() as i32);
    let upper = image.data().as_ptr() as *const i32;
    // SAFETY: the image has a second row, as `sample` asserts.
    let lower = unsafe { image.data().as_ptr().add(image.width()) } as *const i32;
    // The first two bytes of each 32 bits as two 16-bit numbers.
    let pairs = _mm256_setr_epi8(
        0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1, 12, -1, 13, -1, 0, -1, 1, -1, 4, -1, 5, -1, 8, -1, 9, -1,
        12, -1, 13, -1,
    );
    let (byte, whole) = (_mm256_set1_epi32(0xff), _mm256_set1_epi32(256));
    let unit = _mm256_set1_ps(1.0 / 65536.0);
    for k in (0..PADDED).step_by(8) {
        // SAFETY: k + 8 is at most the length of both tables.
        let (i, j) = unsafe {
            (
                _mm256_loadu_si256(OFFSETS[0].as_ptr().add(k) as *const __m256i),
                _mm256_loadu_si256(OFFSETS[1].as_ptr().add(k) as *const __m256i),
            )
        };
        let px = _mm256_add_epi32(x, _mm256_add_epi32(_mm256_mullo_epi32(i, a), _mm256_mullo_epi32(j, b)));
        let py = _mm256_add_epi32(y, _mm256_add_epi32(_mm256_mullo_epi32(i, c), _mm256_mullo_epi32(j, d)));
        let fx = _mm256_and_si256(_mm256_srli_epi32(px, 8), byte);
        let fy = _mm256_and_si256(_mm256_srli_epi32(py, 8), byte);
        let at = _mm256_add_epi32(
            _mm256_mullo_epi32(_mm256_srai_epi32(py, 16), stride),
            _mm256_srai_epi32(px, 16),
        );
        // SAFETY: four bytes from each position are inside the image, in its row and in the next.
        let (top, bottom) =
            unsafe { (_mm256_i32gather_epi32::<1>(upper, at), _mm256_i32gather_epi32::<1>(lower, at)) };
        let weights = _mm256_or_si256(_mm256_sub_epi32(whole, fx), _mm256_slli_epi32(fx, 16));
        let top = _mm256_madd_epi16(_mm256_shuffle_epi8(top, pairs), weights);
        let bottom = _mm256_madd_epi16(_mm256_shuffle_epi8(bottom, pairs), weights);
        let value = _mm256_add_epi32(
            _mm256_slli_epi32(top, 8),
            _mm256_mullo_epi32(_mm256_sub_epi32(bottom, top), fy),
        );
        // SAFETY: k + 8 is at most the length of the patch.
        unsafe { _mm256_storeu_ps(out.as_mut_ptr().add(k), _mm256_mul_ps(_mm256_cvtepi32_ps(value), unit)) };
    }
}
