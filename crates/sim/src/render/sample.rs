//! Filtered texture lookups: bilinear within a level, linear between levels, several along the long axis of
//! the pixel's footprint.
//!
//! Sources: Williams, "Pyramidal parametrics" (1983); footprint as Heckbert (1989); taps along the major axis as
//! McCormack et al., "Feline" (1999), with equal weights.

use crate::texture::{Level, Texture};

/// Places handled together.
pub(crate) const LANES: usize = 8;
/// All weights of a lookup sum to this.
const WEIGHT_ONE: i32 = 4096;
const MAX_TAPS: i32 = 8;

/// The logarithm to base two of a number from 1, from its exponent and a parabola through its mantissa: within
/// 0.01, the same on every machine.
#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits(bits & 0x007F_FFFF | 0x3F80_0000) - 1.0;
    ((bits >> 23) as i32 - 127) as f32 + mantissa * (1.0 + 0.34 * (1.0 - mantissa))
}

/// The filters at several places, each derived from the footprint of a pixel on the texture.
#[derive(Default)]
pub(crate) struct Filters {
    level: [i32; LANES],
    /// Weight of the next coarser level, in 1/`WEIGHT_ONE`.
    next: [i32; LANES],
    taps: [i32; LANES],
    /// From tap to tap, in texels of level 0.
    step: [[f32; LANES]; 2],
}

impl Filters {
    /// From the derivatives of the texture coordinates by pixel, in texels of level 0, and the coarsest level of each texture.
    #[inline(always)]
    pub fn new(derivatives: &[[f32; LANES]; 4], last: &[i32; LANES]) -> Self {
        let mut out = Self::default();
        for i in 0..LANES {
            let [ux, vx, uy, vy] = derivatives.map(|d| d[i]);
            // Singular values of the Jacobian by its symmetric square.
            let (a, b, c) = (ux * ux + uy * uy, ux * vx + uy * vy, vx * vx + vy * vy);
            let (half, diff) = (0.5 * (a + c), 0.5 * (a - c));
            let root = (diff * diff + b * b).sqrt();
            let major = (half + root).max(1e-12).sqrt();
            let minor = (half - root).max(0.0).sqrt();
            // Rounded to nearest: a slightly elongated footprint is blurred a little instead of sampled twice.
            let ratio = major / minor.max(1.0);
            let taps = ((ratio + 0.5) as i32).clamp(1, MAX_TAPS);
            // A bilinear lookup covers about one texel: taps spaced by one texel of the level leave no gaps.
            let width = minor.max(major / taps as f32).max(1.0);
            let lod = log2(width);
            let whole = lod as i32;
            let next = ((lod - whole as f32) * WEIGHT_ONE as f32) as i32;
            // A sixteenth on either side is not worth a second level.
            let near = next > WEIGHT_ONE - WEIGHT_ONE / 16;
            let level = (whole + i32::from(near)).min(last[i]);
            let alone = near | (level >= last[i]) | (next < WEIGHT_ONE / 16);
            let (dx, dy) = (b, half + root - a);
            let round = dx.abs() + dy.abs() < 1e-9;
            let (other_x, other_y) = if a >= c { (1.0, 0.0) } else { (0.0, 1.0) };
            let (dx, dy) = (if round { other_x } else { dx }, if round { other_y } else { dy });
            let scale = major / (taps as f32 * (dx * dx + dy * dy).sqrt());
            (out.level[i], out.next[i], out.taps[i]) = (level, if alone { 0 } else { next }, taps);
            (out.step[0][i], out.step[1][i]) = (dx * scale, dy * scale);
        }
        out
    }

    /// The levels that one of the filters reads, the weight of the second, and the shifts of its taps.
    #[inline(always)]
    fn lane<'a>(&self, i: usize, texture: &'a Texture) -> (&'a Level, Option<&'a Level>, i32, i32) {
        let level = self.level[i] as usize;
        let next = (self.next[i] > 0).then(|| &texture.levels[level + 1]);
        (&texture.levels[level], next, self.next[i], self.taps[i])
    }

    /// Looks up several places with one of the filters; the result is 256 times the grey level.
    #[inline(always)]
    pub fn block<const AVX2: bool>(
        &self,
        which: usize,
        texture: &Texture,
        uv: &[[f32; LANES]; 2],
    ) -> [i32; LANES] {
        let mut sum = [0; LANES];
        let (fine, coarse, next, taps) = self.lane(which, texture);
        let tap_weight = WEIGHT_ONE / taps;
        let rest = WEIGHT_ONE - tap_weight * taps;
        for tap in 0..taps {
            let weight = if tap == taps / 2 { tap_weight + rest } else { tap_weight };
            let k = tap as f32 - 0.5 * (taps - 1) as f32;
            let shift = self.step.map(|s| k * s[which]);
            let second = weight * next / WEIGHT_ONE;
            fine.add::<AVX2>(uv, shift, weight - second, &mut sum);
            if let Some(coarse) = coarse {
                coarse.add::<AVX2>(uv, shift, second, &mut sum);
            }
        }
        sum.map(|s| (s as u32 / WEIGHT_ONE as u32) as i32)
    }

    /// Looks up one place with its filter; the result is 256 times the grey level.
    #[inline(always)]
    pub fn one(&self, which: usize, texture: &Texture, u: f32, v: f32) -> i32 {
        let (fine, coarse, next, taps) = self.lane(which, texture);
        let mut sum = 0;
        for tap in 0..taps {
            let k = tap as f32 - 0.5 * (taps - 1) as f32;
            let (x, y) = (u + k * self.step[0][which], v + k * self.step[1][which]);
            let value = fine.at(x, y);
            sum += value + coarse.map_or(0, |c| (c.at(x, y) - value) * next / WEIGHT_ONE);
        }
        sum / taps
    }
}

impl Level {
    /// Adds one weighted bilinear lookup at each of several places, as 256 times the grey level.
    #[inline(always)]
    fn add<const AVX2: bool>(
        &self,
        uv: &[[f32; LANES]; 2],
        shift: [f32; 2],
        weight: i32,
        sum: &mut [i32; LANES],
    ) {
        #[cfg(target_arch = "x86_64")]
        if AVX2 {
            #[allow(unsafe_code)]
            // SAFETY: only the passes that were compiled for AVX2, on a processor that has it, ask for it.
            unsafe {
                self.add_avx2(uv, shift, weight, sum);
            }
            return;
        }
        // Adding 1.5 * 2^23 leaves the rounded integer in the low bits (for less than 2^22 in size).
        const MAGIC: f32 = 12_582_912.0;
        for (i, sum) in sum.iter_mut().enumerate() {
            // The border of one texel shifts by +1, the texel centre by -1/2.
            let place = |k: usize, size: usize| {
                let at = (uv[k][i] + shift[k]) * self.scale + 128.0;
                (at.max(0.0).min((size * 256) as f32) + MAGIC).to_bits() as i32 - MAGIC.to_bits() as i32
            };
            *sum += self.mixed(place(0, self.width), place(1, self.height)) * weight;
        }
    }

    /// As [`Level::add`] on any machine.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[inline]
    #[allow(unsafe_code)]
    fn add_avx2(&self, uv: &[[f32; LANES]; 2], shift: [f32; 2], weight: i32, sum: &mut [i32; LANES]) {
        use std::arch::x86_64::*;
        let place = |k: usize, size: usize| {
            // SAFETY: there are eight numbers.
            let c = unsafe { _mm256_loadu_ps(uv[k].as_ptr()) };
            let at = _mm256_mul_ps(_mm256_add_ps(c, _mm256_set1_ps(shift[k])), _mm256_set1_ps(self.scale));
            let at = _mm256_max_ps(_mm256_add_ps(at, _mm256_set1_ps(128.0)), _mm256_setzero_ps());
            let at = _mm256_min_ps(at, _mm256_set1_ps((size * 256) as f32));
            _mm256_castps_si256(_mm256_add_ps(at, _mm256_set1_ps(12_582_912.0)))
        };
        let (x, y) = (place(0, self.width), place(1, self.height));
        // Whole texels: 14 bits of each beside each other, for one multiplication by 1 and the stride.
        let column = _mm256_and_si256(_mm256_srli_epi32::<8>(x), _mm256_set1_epi32(0x3FFF));
        let row = _mm256_and_si256(_mm256_slli_epi32::<8>(y), _mm256_set1_epi32(0x3FFF_0000));
        let rows = _mm256_set1_epi32(1 | (self.stride as i32) << 16);
        let pair = _mm256_madd_epi16(_mm256_or_si256(column, row), rows);
        // SAFETY: columns are 0 to the width and rows 0 to the height, so that this pair and the next lie within the level.
        let texels = unsafe { _mm256_i32gather_epi32::<2>(self.pairs.as_ptr().cast(), pair) };
        let part = |v| _mm256_and_si256(v, _mm256_set1_epi32(255));
        let (fx, fy) = (part(x), part(y));
        let left_right =
            _mm256_sub_epi32(_mm256_add_epi32(_mm256_slli_epi32::<16>(fx), _mm256_set1_epi32(256)), fx);
        let top = _mm256_madd_epi16(_mm256_and_si256(texels, _mm256_set1_epi16(255)), left_right);
        let bottom = _mm256_madd_epi16(_mm256_srli_epi16::<8>(texels), left_right);
        let down = _mm256_mullo_epi32(_mm256_sub_epi32(bottom, top), fy);
        let value = _mm256_srli_epi32::<8>(_mm256_add_epi32(_mm256_slli_epi32::<8>(top), down));
        let weighted = _mm256_mullo_epi32(value, _mm256_set1_epi32(weight));
        // SAFETY: there are eight numbers.
        unsafe {
            let sum: *mut __m256i = sum.as_mut_ptr().cast();
            _mm256_storeu_si256(sum, _mm256_add_epi32(_mm256_loadu_si256(sum), weighted));
        }
    }

    /// One bilinear lookup; 256 times the grey level.
    #[inline(always)]
    fn at(&self, u: f32, v: f32) -> i32 {
        let place =
            |c: f32, size: usize| (c * self.scale + 128.5).clamp(0.0, (size * 256) as f32) as i32;
        self.mixed(place(u, self.width), place(v, self.height))
    }

    /// Of the four texels at a place in 1/256 texels.
    #[inline(always)]
    fn mixed(&self, x: i32, y: i32) -> i32 {
        let o = (y >> 8) as usize * self.stride + (x >> 8) as usize;
        let Some([[a, c], [b, d]]) = self.pairs.get(o..).and_then(<[_]>::first_chunk) else { return 0 };
        let [a, b, c, d] = [a, b, c, d].map(|t| i32::from(*t));
        let (fx, fy) = (x & 255, y & 255);
        let top = (a << 8) + (b - a) * fx;
        let bottom = (c << 8) + (d - c) * fx;
        ((top << 8) + (bottom - top) * fy) >> 8
    }
}
