//! AVX-512 version of [`super::orientation`]: two rows at a time, identical results.
#![allow(unsafe_code)]

use super::orientation_scalar::{HALF_WIDTH, RADIUS};
use cairn_sensor::GrayImage;
use std::arch::x86_64::*;

/// For each distance from the middle row: the weights of the 32 pixels starting 16 left of the centre in the row above,
/// then in the row below, zero outside of the disc; for the moments along x, then along y. The middle row counts once.
static WEIGHTS: [[[i8; 64]; 2]; RADIUS + 1] = {
    let mut out = [[[0; 64]; 2]; RADIUS + 1];
    let mut dy = 0;
    while dy <= RADIUS {
        let mut i = 16 - HALF_WIDTH[dy];
        while i <= 16 + HALF_WIDTH[dy] {
            out[dy][0][i] = i as i8 - 16;
            out[dy][1][i] = -(dy as i8);
            if dy > 0 {
                out[dy][0][32 + i] = i as i8 - 16;
                out[dy][1][32 + i] = dy as i8;
            }
            i += 1;
        }
        dy += 1;
    }
    out
};

/// First moments of the disc around a pixel at least 16 from the edge.
pub(super) fn moments(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    let (w, h) = (image.width(), image.height());
    assert!(x >= 16 && y >= 16 && x + 16 <= w && y + 16 <= h && super::Backend::Avx512.available());
    // SAFETY: the instructions are available; columns x - 16 to x + 15 of rows y - 15 to y + 15 are inside.
    unsafe { moments_avx512(image, x, y) }
}

/// # Safety
/// AVX-512 F, BW and VNNI must be available, and the patch inside the image as [`moments`] asserts.
#[target_feature(enable = "avx512f,avx512bw,avx512vnni")]
unsafe fn moments_avx512(image: &GrayImage, x: usize, y: usize) -> [i32; 2] {
    let (mut m10, mut m01) = (_mm512_setzero_si512(), _mm512_setzero_si512());
    for (dy, weights) in WEIGHTS.iter().enumerate() {
        // SAFETY: the patch is inside the image; the tables are 64 bytes long.
        unsafe {
            let centre = image.data().as_ptr().add(y * image.width() + x - 16);
            let row = |p: *const u8| _mm256_loadu_si256(p as *const __m256i);
            let above = _mm512_castsi256_si512(row(centre.sub(dy * image.width())));
            let both = _mm512_inserti64x4::<1>(above, row(centre.add(dy * image.width())));
            let weight = |k: usize| _mm512_loadu_si512(weights[k].as_ptr() as *const __m512i);
            m10 = _mm512_dpbusd_epi32(m10, both, weight(0));
            m01 = _mm512_dpbusd_epi32(m01, both, weight(1));
        }
    }
    [_mm512_reduce_add_epi32(m10), _mm512_reduce_add_epi32(m01)]
}
