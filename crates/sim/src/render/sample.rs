//! Filtered texture lookups: bilinear within a level, linear between levels, several along the long axis of
//! the pixel's footprint.
//!
//! Sources: Williams, "Pyramidal parametrics" (1983); footprint as Heckbert (1989); taps along the major axis as
//! McCormack et al., "Feline" (1999), with equal weights.

use crate::texture::{Level, TILE, Texture};

/// Places handled together.
pub(crate) const LANES: usize = 8;
/// All weights of a lookup sum to this.
const WEIGHT_ONE: i32 = 4096;
const MAX_TAPS: f32 = 8.0;

/// Added to a number from 0 to 2^22, it leaves the rounded integer in the low bits: 1.5 * 2^23.
const MAGIC: f32 = 12_582_912.0;

/// The logarithm to base two of a number from 1, from its exponent and a parabola through its mantissa: within
/// 0.01, the same on every machine.
#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits(bits & 0x007F_FFFF | 0x3F80_0000) - 1.0;
    ((bits >> 23) as i32 - 127) as f32 + mantissa * (1.0 + 0.34 * (1.0 - mantissa))
}

/// The whole part of a number from 0 to 2^22, as compilers turn it into vector instructions.
#[inline(always)]
fn whole(x: f32) -> i32 {
    let rounded = x + MAGIC;
    rounded.to_bits() as i32 - MAGIC.to_bits() as i32 - i32::from(rounded - MAGIC > x)
}

/// The filters at several places, each derived from the footprint of a pixel on the texture.
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
        let (mut level, mut next, mut taps) = ([0; LANES], [0; LANES], [0; LANES]);
        let mut step = [[0.0; LANES]; 2];
        let [ux, vx, uy, vy] = derivatives;
        for i in 0..LANES {
            let (ux, vx, uy, vy) = (ux[i], vx[i], uy[i], vy[i]);
            // Singular values of the Jacobian by its symmetric square.
            let (a, b, c) = (ux * ux + uy * uy, ux * vx + uy * vy, vx * vx + vy * vy);
            let (half, diff) = (0.5 * (a + c), 0.5 * (a - c));
            let root = (diff * diff + b * b).sqrt();
            let major = (half + root).max(1e-12).sqrt();
            let minor = (half - root).max(0.0).sqrt();
            // Rounded to nearest: a slightly elongated footprint is blurred a little instead of sampled twice.
            let ratio = major / minor.max(1.0);
            let count = whole((ratio + 0.5).min(MAX_TAPS)).max(1);
            // A bilinear lookup covers about one texel: taps spaced by one texel of the level leave no gaps.
            let width = minor.max(major / count as f32).max(1.0);
            let lod = log2(width);
            let floor = whole(lod);
            let share = whole((lod - floor as f32) * WEIGHT_ONE as f32);
            // A sixteenth on either side is not worth a second level.
            let near = share > WEIGHT_ONE - WEIGHT_ONE / 16;
            level[i] = (floor + i32::from(near)).min(last[i]);
            let alone = near | (level[i] >= last[i]) | (share < WEIGHT_ONE / 16);
            let (dx, dy) = (b, half + root - a);
            let round = dx.abs() + dy.abs() < 1e-9;
            let (other_x, other_y) = if a >= c { (1.0, 0.0) } else { (0.0, 1.0) };
            let (dx, dy) = (if round { other_x } else { dx }, if round { other_y } else { dy });
            let scale = major / (count as f32 * (dx * dx + dy * dy).sqrt());
            (next[i], taps[i]) = (if alone { 0 } else { share }, count);
            (step[0][i], step[1][i]) = (dx * scale, dy * scale);
        }
        Self { level, next, taps, step }
    }

    /// The level that one of the filters reads, the coarser one beside it, the weight of that, and the number of taps.
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
        let step = self.step.map(|s| s[which]);
        let tap_weight = WEIGHT_ONE / taps;
        let rest = WEIGHT_ONE - tap_weight * taps;
        for tap in 0..taps {
            let weight = if tap == taps / 2 { tap_weight + rest } else { tap_weight };
            let k = tap as f32 - 0.5 * (taps - 1) as f32;
            let shift = step.map(|s| k * s);
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
        (sum as u32 / taps as u32) as i32
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
        for (i, sum) in sum.iter_mut().enumerate() {
            // The border of one texel shifts by +1, the texel centre by -1/2.
            let place = |k: usize| {
                let at = (uv[k][i] + shift[k]) * self.scale + 128.0;
                (at.max(0.0).min(self.limits[k]) + MAGIC).to_bits() as i32 - MAGIC.to_bits() as i32
            };
            *sum += self.mixed(place(0), place(1)) * weight;
        }
    }

    /// As the rest of [`Level::add`], eight at once. Gathers take longer than loads on many processors.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[inline]
    #[allow(unsafe_code)]
    fn add_avx2(&self, uv: &[[f32; LANES]; 2], shift: [f32; 2], weight: i32, sum: &mut [i32; LANES]) {
        use std::arch::x86_64::*;
        let place = |k: usize| {
            // SAFETY: there are eight numbers.
            let c = unsafe { _mm256_loadu_ps(uv[k].as_ptr()) };
            let at = _mm256_mul_ps(_mm256_add_ps(c, _mm256_set1_ps(shift[k])), _mm256_set1_ps(self.scale));
            let at = _mm256_max_ps(_mm256_add_ps(at, _mm256_set1_ps(128.0)), _mm256_setzero_ps());
            let at = _mm256_min_ps(at, _mm256_set1_ps(self.limits[k]));
            _mm256_castps_si256(_mm256_add_ps(at, _mm256_set1_ps(MAGIC)))
        };
        let (x, y) = (place(0), place(1));
        // Whole texels: 14 bits of each beside each other. The factor divides them by the side of a tile.
        let column = _mm256_and_si256(_mm256_srli_epi32::<8>(x), _mm256_set1_epi32(0x3FFF));
        let row = _mm256_and_si256(_mm256_slli_epi32::<8>(y), _mm256_set1_epi32(0x3FFF_0000));
        let whole = _mm256_or_si256(column, row);
        let tile = _mm256_mulhi_epu16(whole, _mm256_set1_epi16((0x1_0000 / TILE + 1) as i16));
        let inside = _mm256_sub_epi16(whole, _mm256_mullo_epi16(tile, _mm256_set1_epi16(TILE as i16)));
        let tile = _mm256_madd_epi16(tile, _mm256_set1_epi32(1 | (self.stride as i32) << 16));
        let inside = _mm256_madd_epi16(inside, _mm256_set1_epi32(1 | 8 << 16));
        let o = _mm256_add_epi32(_mm256_slli_epi32::<6>(tile), inside);
        let mut at = [0i32; LANES];
        // SAFETY: columns are 0 to the width and rows 0 to the height, so that the tiles are those of the level; in a tile both are 0
        // to 6, so that the last of the four bytes read are the 58th and the 64th.
        let [upper, lower] = unsafe {
            _mm256_storeu_si256(at.as_mut_ptr().cast(), o);
            [0, 6].map(|more| {
                let first = self.tiles.as_ptr().byte_add(more);
                let [a, b, c, d, e, f, g, h] =
                    at.map(|o| first.byte_add(o as usize).cast::<i32>().read_unaligned());
                _mm256_setr_epi32(a, b, c, d, e, f, g, h)
            })
        };
        let part = |v| _mm256_and_si256(v, _mm256_set1_epi32(255));
        let (fx, fy) = (part(x), part(y));
        let left_right =
            _mm256_sub_epi32(_mm256_add_epi32(_mm256_slli_epi32::<16>(fx), _mm256_set1_epi32(256)), fx);
        // The lowest two bytes of each four of the upper row, and the highest of the lower, each as 16 bits.
        let spread = |first: i32| {
            let each = first | (first + 1) << 16 | 0x8000_8000u32 as i32;
            let four =
                _mm_add_epi32(_mm_set_epi32(12, 8, 4, 0), _mm_set_epi32(12 << 16, 8 << 16, 4 << 16, 0));
            _mm256_broadcastsi128_si256(_mm_add_epi32(_mm_set1_epi32(each), four))
        };
        let top = _mm256_madd_epi16(_mm256_shuffle_epi8(upper, spread(0)), left_right);
        let bottom = _mm256_madd_epi16(_mm256_shuffle_epi8(lower, spread(2)), left_right);
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
        let [x, y] = [0, 1].map(|k| ([u, v][k] * self.scale + 128.5).max(0.0).min(self.limits[k]) as i32);
        self.mixed(x, y)
    }

    /// Of the four texels at a place in 1/256 texels.
    #[inline(always)]
    fn mixed(&self, x: i32, y: i32) -> i32 {
        let (column, row) = ((x >> 8) as usize, (y >> 8) as usize);
        let Some(tile) = self.tiles.get(row / TILE * self.stride + column / TILE) else { return 0 };
        let o = row % TILE * 8 + column % TILE;
        let [a, b, c, d] = [o, o + 1, o + 8, o + 9].map(|o| i32::from(tile.0[o]));
        let (fx, fy) = (x & 255, y & 255);
        let top = (a << 8) + (b - a) * fx;
        let bottom = (c << 8) + (d - c) * fx;
        ((top << 8) + (bottom - top) * fy) >> 8
    }
}
