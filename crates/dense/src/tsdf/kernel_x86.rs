//! Versions of the loops in [`super::kernel`] with eight and sixteen lanes: the same operations, bit-identical results.
#![allow(unsafe_code)]

use super::bits::Bits;
use super::kernel::{Addition, Colours, NO_PIXEL, Pass, Planes, STEPS};
use crate::block::VOXELS;
use crate::pixel::WEIGHT_BITS;
use crate::view::NEAREST_M;
use std::arch::x86_64::*;

/// # Safety
/// AVX-512 F must be available; `pass.pixels` holds `width * height` pixels.
#[target_feature(enable = "avx512f")]
pub unsafe fn find_addition_avx512(out: &mut Addition, origin: [f32; 3], pass: &Pass) -> bool {
    let [ou, ov, oz] = origin.map(|v| _mm512_set1_ps(v));
    let (one, zero, near) = (_mm512_set1_ps(1.0), _mm512_setzero_ps(), _mm512_set1_ps(NEAREST_M));
    let (width, height) = (_mm512_set1_ps(pass.width as f32), _mm512_set1_ps(pass.height as f32));
    let stride = _mm512_set1_epi32(pass.width as i32);
    let bits = _mm512_set1_epi32(WEIGHT_BITS as i32);
    let (band, back) = (_mm512_set1_ps(pass.band_m), _mm512_set1_ps(-pass.band_m));
    let (scale, most) = (_mm512_set1_ps(pass.scale), _mm512_set1_ps(STEPS as f32));
    let (shift, steps_of) = (_mm512_set1_ps(STEPS as f32 + 0.5), _mm512_set1_epi32(STEPS));
    let sign = _mm512_set1_epi32(pass.sign);
    let has_colour = !pass.colours.is_empty();
    let (none, no_pixel) = (_mm512_setzero_si512(), _mm512_set1_epi32(NO_PIXEL as i32));
    let mut in_band = 0;
    for i in (0..VOXELS).step_by(16) {
        // SAFETY: i + 16 <= VOXELS, the length of all planes; gathered indices lie inside the image.
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
            let [sums, weights]: [*mut __m512i; 2] =
                [out.sum.as_mut_ptr().add(i).cast(), out.weight.as_mut_ptr().add(i).cast()];
            let at =
                _mm512_add_epi32(_mm512_mullo_epi32(_mm512_cvttps_epi32(v), stride), _mm512_cvttps_epi32(u));
            let pixel = _mm512_mask_i32gather_epi32::<4>(none, m, at, pass.pixels.as_ptr().cast());
            let weight = _mm512_and_si512(pixel, bits);
            let depth = _mm512_castsi512_ps(_mm512_andnot_si512(bits, pixel));
            let distance = _mm512_sub_ps(depth, z);
            m = _mm512_mask_test_epi32_mask(m, weight, weight);
            m = _mm512_mask_cmp_ps_mask::<_CMP_GE_OQ>(m, distance, back);
            let close = _mm512_mask_cmp_ps_mask::<_CMP_LT_OQ>(m, distance, band);
            in_band |= close;
            let part = _mm512_add_ps(_mm512_min_ps(_mm512_mul_ps(distance, scale), most), shift);
            let steps = _mm512_sub_epi32(_mm512_cvttps_epi32(part), steps_of);
            let weight = _mm512_mullo_epi32(weight, sign);
            _mm512_store_si512(sums, _mm512_maskz_mullo_epi32(m, weight, steps));
            _mm512_store_si512(weights, _mm512_maskz_mov_epi32(m, weight));
            if has_colour {
                let pixel = _mm512_mask_mov_epi32(no_pixel, close, at);
                _mm512_store_si512(out.pixel.as_mut_ptr().add(i).cast(), pixel);
            }
        }
    }
    in_band != 0
}

/// [`Planes::add`] and [`Bits::read`] in one.
///
/// # Safety
/// AVX-512 F must be available.
#[target_feature(enable = "avx512f")]
pub unsafe fn add_avx512(planes: &mut Planes, bits: &mut Bits, addition: &Addition) {
    let none = _mm512_setzero_si512();
    for (z, (seen, inside)) in bits.seen.iter_mut().zip(&mut bits.inside).enumerate() {
        (*seen, *inside) = (0, 0);
        for k in (0..64).step_by(16) {
            let i = 64 * z + k;
            // SAFETY: i + 16 <= VOXELS, the length of all planes.
            unsafe {
                let sums: *mut __m512i = planes.sum.as_mut_ptr().add(i).cast();
                let weights: *mut __m512i = planes.weight.as_mut_ptr().add(i).cast();
                let sum = _mm512_load_si512(addition.sum.as_ptr().add(i).cast());
                let sum = _mm512_add_epi32(_mm512_load_si512(sums), sum);
                let weight = _mm512_load_si512(addition.weight.as_ptr().add(i).cast());
                let weight = _mm512_add_epi32(_mm512_load_si512(weights), weight);
                _mm512_store_si512(sums, sum);
                _mm512_store_si512(weights, weight);
                *seen |= u64::from(_mm512_cmpgt_epi32_mask(weight, none)) << k;
                *inside |= u64::from(_mm512_cmplt_epi32_mask(sum, none)) << k;
            }
        }
    }
}

/// [`Colours::add`].
///
/// # Safety
/// AVX-512 F must be available; the pixels of `addition` are pixels of `pass.colours`.
#[target_feature(enable = "avx512f")]
pub unsafe fn colour_avx512(colours: &mut Colours, addition: &Addition, pass: &Pass) {
    let (none, no_pixel) = (_mm512_setzero_si512(), _mm512_set1_epi32(NO_PIXEL as i32));
    let (byte, sign) = (_mm512_set1_epi32(255), _mm512_set1_epi32(pass.sign));
    for i in (0..VOXELS).step_by(16) {
        // SAFETY: i + 16 <= VOXELS, the length of all planes; gathered indices lie inside the image.
        unsafe {
            let at = _mm512_load_si512(addition.pixel.as_ptr().add(i).cast());
            let close = _mm512_cmpneq_epi32_mask(at, no_pixel);
            if close == 0 {
                continue;
            }
            let c = _mm512_mask_i32gather_epi32::<4>(none, close, at, pass.colours.as_ptr().cast());
            let parts = [
                _mm512_and_si512(c, byte),
                _mm512_and_si512(_mm512_srli_epi32::<8>(c), byte),
                _mm512_and_si512(_mm512_srli_epi32::<16>(c), byte),
                _mm512_set1_epi32(1),
            ];
            for (plane, part) in colours.planes.iter_mut().zip(parts) {
                let to: *mut __m512i = plane.as_mut_ptr().add(i).cast();
                let old = _mm512_load_si512(to);
                _mm512_store_si512(
                    to,
                    _mm512_mask_add_epi32(old, close, old, _mm512_mullo_epi32(part, sign)),
                );
            }
        }
    }
}

/// # Safety
/// AVX2 must be available; `pass.pixels` holds `width * height` pixels.
#[target_feature(enable = "avx2")]
pub unsafe fn find_addition_avx2(out: &mut Addition, origin: [f32; 3], pass: &Pass) -> bool {
    let [ou, ov, oz] = origin.map(|v| _mm256_set1_ps(v));
    let (one, zero, near) = (_mm256_set1_ps(1.0), _mm256_setzero_ps(), _mm256_set1_ps(NEAREST_M));
    let (width, height) = (_mm256_set1_ps(pass.width as f32), _mm256_set1_ps(pass.height as f32));
    let stride = _mm256_set1_epi32(pass.width as i32);
    let bits = _mm256_set1_epi32(WEIGHT_BITS as i32);
    let (band, back) = (_mm256_set1_ps(pass.band_m), _mm256_set1_ps(-pass.band_m));
    let (scale, most) = (_mm256_set1_ps(pass.scale), _mm256_set1_ps(STEPS as f32));
    let (shift, steps_of) = (_mm256_set1_ps(STEPS as f32 + 0.5), _mm256_set1_epi32(STEPS));
    let sign = _mm256_set1_epi32(pass.sign);
    let has_colour = !pass.colours.is_empty();
    let (none, no_pixel) = (_mm256_setzero_si256(), _mm256_set1_epi32(NO_PIXEL as i32));
    let mut in_band = 0;
    for i in (0..VOXELS).step_by(8) {
        // SAFETY: i + 8 <= VOXELS, the length of all planes; gathered indices lie inside the image.
        unsafe {
            let z = _mm256_add_ps(oz, _mm256_load_ps(pass.offsets.z.as_ptr().add(i)));
            let inverse = _mm256_div_ps(one, z);
            let u = _mm256_mul_ps(_mm256_add_ps(ou, _mm256_load_ps(pass.offsets.u.as_ptr().add(i))), inverse);
            let v = _mm256_mul_ps(_mm256_add_ps(ov, _mm256_load_ps(pass.offsets.v.as_ptr().add(i))), inverse);
            let low =
                _mm256_and_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(u, zero), _mm256_cmp_ps::<_CMP_GE_OQ>(v, zero));
            let high =
                _mm256_and_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(u, width), _mm256_cmp_ps::<_CMP_LT_OQ>(v, height));
            let inside = _mm256_and_ps(_mm256_and_ps(low, high), _mm256_cmp_ps::<_CMP_GE_OQ>(z, near));
            let inside = _mm256_castps_si256(inside);
            let at =
                _mm256_add_epi32(_mm256_mullo_epi32(_mm256_cvttps_epi32(v), stride), _mm256_cvttps_epi32(u));
            let pixel = _mm256_mask_i32gather_epi32::<4>(none, pass.pixels.as_ptr().cast(), at, inside);
            let weight = _mm256_and_si256(pixel, bits);
            let depth = _mm256_castsi256_ps(_mm256_andnot_si256(bits, pixel));
            let distance = _mm256_sub_ps(depth, z);
            let known = _mm256_castsi256_ps(_mm256_cmpgt_epi32(weight, none));
            let used = _mm256_and_ps(known, _mm256_cmp_ps::<_CMP_GE_OQ>(distance, back));
            let close = _mm256_and_ps(used, _mm256_cmp_ps::<_CMP_LT_OQ>(distance, band));
            in_band |= _mm256_movemask_ps(close);
            let part = _mm256_add_ps(_mm256_min_ps(_mm256_mul_ps(distance, scale), most), shift);
            let steps = _mm256_sub_epi32(_mm256_cvttps_epi32(part), steps_of);
            let weight = _mm256_and_si256(_mm256_mullo_epi32(weight, sign), _mm256_castps_si256(used));
            _mm256_store_si256(out.sum.as_mut_ptr().add(i).cast(), _mm256_mullo_epi32(weight, steps));
            _mm256_store_si256(out.weight.as_mut_ptr().add(i).cast(), weight);
            if has_colour {
                let pixel = _mm256_blendv_epi8(no_pixel, at, _mm256_castps_si256(close));
                _mm256_store_si256(out.pixel.as_mut_ptr().add(i).cast(), pixel);
            }
        }
    }
    in_band != 0
}
