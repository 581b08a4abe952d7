//! AVX-512 version of [`super::descriptor`]: the patch lives in sixteen registers and 64 tests are looked up at a time,
//! bit-identical.
#![allow(unsafe_code)]

use super::BORDER;
use super::pattern::PATTERN;
use crate::Descriptor;
use std::arch::x86_64::*;

/// Rows of the patch.
const ROWS: usize = 31;

/// Points of the pattern, x and y, in groups of 64 tests: the first points in four vectors, then the second. The order
/// within a group is such that packing the four vectors to bytes gives the order of the tests.
static POINTS: [[[[i16; 32]; 4]; 2]; 4] = {
    let mut out = [[[[0; 32]; 4]; 2]; 4];
    let mut i = 0;
    while i < 256 {
        // Packing takes four numbers of each vector in turn, for each 128 bits.
        let (group, lane, vector, number) = (i / 64, i % 64 / 16, i % 16 / 4, i % 4);
        let at = 2 * (4 * lane + number);
        let mut k = 0;
        while k < 4 {
            out[group][k / 2][vector][at + k % 2] = PATTERN[i][k] as i16;
            k += 1;
        }
        i += 1;
    }
    out
};

/// See [`super::descriptor::describe`].
pub(super) fn describe(data: &[u8], stride: usize, centre: usize, direction: [i16; 2]) -> Descriptor {
    let reach = (BORDER - 1) * stride + BORDER;
    assert!(centre >= reach && centre + reach <= data.len() && super::Backend::Avx512.available());
    // SAFETY: the instructions are available; the rows of the patch begin at centre - reach or later and end at
    // centre + reach or earlier.
    unsafe { describe_avx512(data, stride, centre, direction) }
}

/// # Safety
/// AVX-512 F, BW and VBMI must be available, and the patch inside the data as [`describe`] asserts.
#[target_feature(enable = "avx512f,avx512bw,avx512vbmi")]
unsafe fn describe_avx512(data: &[u8], stride: usize, centre: usize, [c, s]: [i16; 2]) -> Descriptor {
    // Two rows of 32 pixels, from 16 left of the centre on, in each register.
    let patch: [__m512i; 16] = std::array::from_fn(|i| {
        // SAFETY: see `describe`; the last register has one row only.
        unsafe {
            let first = data.as_ptr().add(centre - (BORDER - 1) * stride - BORDER + 2 * i * stride);
            let row = |p: *const u8| _mm256_loadu_si256(p as *const __m256i);
            let upper = _mm512_castsi256_si512(row(first));
            if 2 * i + 1 < ROWS { _mm512_inserti64x4::<1>(upper, row(first.add(stride))) } else { upper }
        }
    });
    let two = |low: i16, high: i16| _mm512_set1_epi32((low as u16 as i32) | (high as i32) << 16);
    let (to_x, to_y) = (two(c, -s), two(s, c));
    // Rounding, and the shift of the centre to column 16 and row 15.
    let (round_x, round_y) = (_mm512_set1_epi32(8192 + (16 << 14)), _mm512_set1_epi32(8192 + (15 << 14)));
    let row_bits = _mm512_set1_epi32(31 << 5);
    // Place of a rotated point in the patch: 32 times its row plus its column.
    let place = |points: &[i16; 32]| {
        // SAFETY: the table's row is 64 bytes long.
        let p = unsafe { _mm512_loadu_si512(points.as_ptr() as *const __m512i) };
        let x = _mm512_srli_epi32::<14>(_mm512_add_epi32(_mm512_madd_epi16(p, to_x), round_x));
        let y = _mm512_srli_epi32::<9>(_mm512_add_epi32(_mm512_madd_epi16(p, to_y), round_y));
        _mm512_or_si512(x, _mm512_and_si512(y, row_bits))
    };
    let low_bits = _mm512_set1_epi16(127);
    let values = |points: &[[i16; 32]; 4]| {
        let [a, b, c, d] = [place(&points[0]), place(&points[1]), place(&points[2]), place(&points[3])];
        let (ab, cd) = (_mm512_packus_epi32(a, b), _mm512_packus_epi32(c, d));
        // A pair of registers has 128 pixels: seven bits are the place in a pair, the rest is the number of the pair.
        let at = _mm512_packus_epi16(_mm512_and_si512(ab, low_bits), _mm512_and_si512(cd, low_bits));
        let pair = _mm512_packus_epi16(_mm512_srli_epi16::<7>(ab), _mm512_srli_epi16::<7>(cd));
        let mut value = _mm512_setzero_si512();
        for i in 0..8 {
            let here = _mm512_cmpeq_epi8_mask(pair, _mm512_set1_epi8(i as i8));
            let found = _mm512_maskz_permutex2var_epi8(here, patch[2 * i], at, patch[2 * i + 1]);
            value = _mm512_or_si512(value, found);
        }
        value
    };
    let mut out = [0u8; 32];
    for (out, [first, second]) in out.as_chunks_mut::<8>().0.iter_mut().zip(&POINTS) {
        *out = _mm512_cmplt_epu8_mask(values(first), values(second)).to_le_bytes();
    }
    out
}
