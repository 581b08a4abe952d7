//! Versions of [`super::kernel::classify`] with eight and sixteen lanes: the same operations, the same result.
#![allow(unsafe_code)]

use super::kernel::{Evidence, FREE, HIT, Nearest, Pass, SILENT};
use crate::block::VOXELS;
use crate::view::NEAREST_M;
use std::arch::x86_64::*;

/// # Safety
/// AVX-512 F must be available; `pass.silent` and `nearest.least` must cover the whole image.
#[target_feature(enable = "avx512f")]
pub unsafe fn classify_avx512(out: &mut Evidence, origin: [f32; 3], nearest: Nearest, pass: &Pass) -> bool {
    let [ou, ov, oz] = origin.map(|v| _mm512_set1_ps(v));
    let (one, zero, near) = (_mm512_set1_ps(1.0), _mm512_setzero_ps(), _mm512_set1_ps(NEAREST_M));
    let [w, h] = pass.size;
    let (width, height) = (_mm512_set1_ps(w as f32), _mm512_set1_ps(h as f32));
    let [floor, growth, from] = pass.noise.map(|v| _mm512_set1_ps(v));
    let (half, two) = (_mm512_set1_ps(pass.half_m), _mm512_set1_ps(2.0));
    let (before, after) = (_mm512_set1_ps(-pass.half_m), _mm512_set1_ps(2.0 * pass.half_m));
    let (silent_m, endless) = (_mm512_set1_ps(pass.silent_m), _mm512_set1_ps(f32::INFINITY));
    let level = _mm_cvtsi32_si128(nearest.level as i32);
    let none = _mm512_setzero_si512();
    let at = |y: __m512i, x: __m512i, stride: usize| {
        _mm512_add_epi32(_mm512_mullo_epi32(y, _mm512_set1_epi32(stride as i32)), x)
    };
    let mut any = 0;
    for i in (0..VOXELS).step_by(16) {
        // SAFETY: i + 16 <= VOXELS, the length of all tables; gathered indices lie inside the image.
        unsafe {
            let z = _mm512_add_ps(oz, _mm512_load_ps(pass.offsets.z.as_ptr().add(i)));
            let inverse = _mm512_div_ps(one, z);
            let u = _mm512_mul_ps(_mm512_add_ps(ou, _mm512_load_ps(pass.offsets.u.as_ptr().add(i))), inverse);
            let v = _mm512_mul_ps(_mm512_add_ps(ov, _mm512_load_ps(pass.offsets.v.as_ptr().add(i))), inverse);
            let mut m = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(z, near);
            m = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(m, u, zero);
            m = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(m, v, zero);
            m = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(m, u, width);
            m = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(m, v, height);
            let to: *mut __m128i = out.0.as_mut_ptr().add(i).cast();
            if m == 0 {
                _mm_store_si128(to, _mm_setzero_si128());
                continue;
            }
            let (x, y) = (_mm512_cvttps_epi32(u), _mm512_cvttps_epi32(v));
            let (column, row) = (_mm512_srl_epi32(x, level), _mm512_srl_epi32(y, level));
            let square = at(row, column, nearest.width);
            let least = _mm512_mask_i32gather_ps::<4>(zero, m, square, nearest.least.as_ptr());
            let behind = _mm512_sub_ps(z, least);
            let hit = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(m, behind, before);
            let hit = _mm512_mask_cmp_ps_mask::<_CMP_LE_OQ>(hit, behind, after);
            let measured = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(m, least, endless);
            let past = _mm512_sub_ps(least, from);
            let noise = _mm512_add_ps(floor, _mm512_mul_ps(growth, _mm512_mul_ps(past, past)));
            let margin = _mm512_add_ps(half, _mm512_mul_ps(two, noise));
            let free =
                _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(measured & !hit, _mm512_add_ps(z, margin), least);
            let mut says = _mm512_maskz_set1_epi32(hit, i32::from(HIT));
            says = _mm512_mask_set1_epi32(says, free, i32::from(FREE));
            let unmeasured = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(m & !measured & !hit, z, silent_m);
            if unmeasured != 0 {
                let tile = at(_mm512_srli_epi32::<3>(y), _mm512_srli_epi32::<3>(x), w.div_ceil(8));
                let quiet =
                    _mm512_mask_i32gather_epi32::<4>(none, unmeasured, tile, pass.silent.as_ptr().cast());
                let quiet = _mm512_mask_test_epi32_mask(unmeasured, quiet, quiet);
                says = _mm512_mask_set1_epi32(says, quiet, i32::from(SILENT));
            }
            any |= _mm512_test_epi32_mask(says, says);
            _mm_store_si128(to, _mm512_cvtepi32_epi8(says));
        }
    }
    any != 0
}

/// # Safety
/// AVX2 must be available; `pass.silent` and `nearest.least` must cover the whole image.
#[target_feature(enable = "avx2")]
pub unsafe fn classify_avx2(out: &mut Evidence, origin: [f32; 3], nearest: Nearest, pass: &Pass) -> bool {
    let [ou, ov, oz] = origin.map(|v| _mm256_set1_ps(v));
    let (one, zero, near) = (_mm256_set1_ps(1.0), _mm256_setzero_ps(), _mm256_set1_ps(NEAREST_M));
    let [w, h] = pass.size;
    let (width, height) = (_mm256_set1_ps(w as f32), _mm256_set1_ps(h as f32));
    let [floor, growth, from] = pass.noise.map(|v| _mm256_set1_ps(v));
    let (half, two) = (_mm256_set1_ps(pass.half_m), _mm256_set1_ps(2.0));
    let (before, after) = (_mm256_set1_ps(-pass.half_m), _mm256_set1_ps(2.0 * pass.half_m));
    let (silent_m, endless) = (_mm256_set1_ps(pass.silent_m), _mm256_set1_ps(f32::INFINITY));
    let level = _mm_cvtsi32_si128(nearest.level as i32);
    let none = _mm256_setzero_si256();
    let at = |y: __m256i, x: __m256i, stride: usize| {
        _mm256_add_epi32(_mm256_mullo_epi32(y, _mm256_set1_epi32(stride as i32)), x)
    };
    let mut any = 0;
    for i in (0..VOXELS).step_by(8) {
        // SAFETY: i + 8 <= VOXELS, the length of all tables; gathered indices lie inside the image.
        unsafe {
            let z = _mm256_add_ps(oz, _mm256_load_ps(pass.offsets.z.as_ptr().add(i)));
            let inverse = _mm256_div_ps(one, z);
            let u = _mm256_mul_ps(_mm256_add_ps(ou, _mm256_load_ps(pass.offsets.u.as_ptr().add(i))), inverse);
            let v = _mm256_mul_ps(_mm256_add_ps(ov, _mm256_load_ps(pass.offsets.v.as_ptr().add(i))), inverse);
            let low =
                _mm256_and_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(u, zero), _mm256_cmp_ps::<_CMP_GE_OQ>(v, zero));
            let high =
                _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(u, width), _mm256_cmp_ps::<_CMP_LT_OQ>(v, height));
            let m = _mm256_and_ps(_mm256_and_ps(low, high), _mm256_cmp_ps::<_CMP_GE_OQ>(z, near));
            let to: *mut __m128i = out.0.as_mut_ptr().add(i).cast();
            if _mm256_movemask_ps(m) == 0 {
                _mm_storel_epi64(to, _mm_setzero_si128());
                continue;
            }
            let (x, y) = (_mm256_cvttps_epi32(u), _mm256_cvttps_epi32(v));
            let (column, row) = (_mm256_srl_epi32(x, level), _mm256_srl_epi32(y, level));
            let square = at(row, column, nearest.width);
            let least = _mm256_mask_i32gather_ps::<4>(zero, nearest.least.as_ptr(), square, m);
            let behind = _mm256_sub_ps(z, least);
            let first = _mm256_cmp_ps::<_CMP_GE_OQ>(behind, before);
            let hit = _mm256_and_ps(m, _mm256_and_ps(first, _mm256_cmp_ps::<_CMP_LE_OQ>(behind, after)));
            let measured = _mm256_and_ps(m, _mm256_cmp_ps::<_CMP_LT_OQ>(least, endless));
            let past = _mm256_sub_ps(least, from);
            let noise = _mm256_add_ps(floor, _mm256_mul_ps(growth, _mm256_mul_ps(past, past)));
            let margin = _mm256_add_ps(half, _mm256_mul_ps(two, noise));
            let through = _mm256_cmp_ps::<_CMP_LT_OQ>(_mm256_add_ps(z, margin), least);
            let free = _mm256_andnot_ps(hit, _mm256_and_ps(measured, through));
            let unmeasured = _mm256_andnot_ps(_mm256_or_ps(measured, hit), m);
            let unmeasured = _mm256_and_ps(unmeasured, _mm256_cmp_ps::<_CMP_LT_OQ>(z, silent_m));
            let says = |mask: __m256, what: u8| {
                _mm256_and_si256(_mm256_castps_si256(mask), _mm256_set1_epi32(i32::from(what)))
            };
            let mut all = _mm256_or_si256(says(hit, HIT), says(free, FREE));
            if _mm256_movemask_ps(unmeasured) != 0 {
                let tile = at(_mm256_srli_epi32::<3>(y), _mm256_srli_epi32::<3>(x), w.div_ceil(8));
                let lanes = _mm256_castps_si256(unmeasured);
                let quiet = _mm256_mask_i32gather_epi32::<4>(none, pass.silent.as_ptr().cast(), tile, lanes);
                let quiet = _mm256_castsi256_ps(_mm256_cmpgt_epi32(quiet, none));
                all = _mm256_or_si256(all, says(quiet, SILENT));
            }
            let words = _mm_packs_epi32(_mm256_castsi256_si128(all), _mm256_extracti128_si256::<1>(all));
            any |= _mm_movemask_epi8(_mm_cmpgt_epi16(words, _mm_setzero_si128()));
            _mm_storel_epi64(to, _mm_packus_epi16(words, words));
        }
    }
    any != 0
}
