//! Filtered texture lookups: bilinear within a level, linear between levels, several along the long axis of
//! the pixel's footprint.
//!
//! Sources: Williams, "Pyramidal parametrics" (1983); footprint as Heckbert (1989); taps along the major axis as
//! McCormack et al., "Feline" (1999), with equal weights.

use crate::texture::{Level, Texture};

/// Pixels handled together.
pub(crate) const BLOCK: usize = 16;
/// All weights of a lookup sum to this.
pub(crate) const WEIGHT_ONE: i32 = 4096;
const MAX_TAPS: i32 = 8;

/// The logarithm to base two of a number from 1, from its exponent and a parabola through its mantissa: within
/// 0.01, the same on every machine.
#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let mantissa = f32::from_bits(bits & 0x007F_FFFF | 0x3F80_0000) - 1.0;
    ((bits >> 23) as i32 - 127) as f32 + mantissa * (1.0 + 0.34 * (1.0 - mantissa))
}

/// The filter at one place, derived from the footprint of a pixel on the texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Filter {
    level: usize,
    /// Weight of the next coarser level, in 1/`WEIGHT_ONE`.
    next: i32,
    taps: i32,
    /// From tap to tap, in texels of level 0.
    step: (f32, f32),
}

impl Filter {
    /// From the derivatives of the texture coordinates by pixel, in texels of level 0.
    #[inline(always)]
    pub fn new(texture: &Texture, ux: f32, vx: f32, uy: f32, vy: f32) -> Self {
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
        let last = texture.levels.len() - 1;
        let lod = log2(width);
        let (mut level, mut next) = (lod as usize, (lod.fract() * WEIGHT_ONE as f32) as i32);
        // A last sixteenth on either side is not worth a second level.
        if next > WEIGHT_ONE - WEIGHT_ONE / 16 {
            (level, next) = (level + 1, 0);
        }
        if level >= last {
            (level, next) = (last, 0);
        }
        if next < WEIGHT_ONE / 16 {
            next = 0;
        }
        let (mut dx, mut dy) = (b, half + root - a);
        if dx.abs() + dy.abs() < 1e-9 {
            (dx, dy) = if a >= c { (1.0, 0.0) } else { (0.0, 1.0) };
        }
        let scale = major / (taps as f32 * (dx * dx + dy * dy).sqrt());
        Self { level, next, taps, step: (dx * scale, dy * scale) }
    }

    /// Looks up a block; the result is 256 times the grey level.
    #[inline(always)]
    pub fn block<const AVX2: bool>(
        &self,
        texture: &Texture,
        u: &[f32; BLOCK],
        v: &[f32; BLOCK],
        out: &mut [i32; BLOCK],
    ) {
        *out = [0; BLOCK];
        let tap_weight = WEIGHT_ONE / self.taps;
        let rest = WEIGHT_ONE - tap_weight * self.taps;
        for tap in 0..self.taps {
            let weight = if tap == self.taps / 2 { tap_weight + rest } else { tap_weight };
            let k = tap as f32 - 0.5 * (self.taps - 1) as f32;
            let (su, sv) = (k * self.step.0, k * self.step.1);
            let coarse = weight * self.next / WEIGHT_ONE;
            let shift = (su, sv);
            bilinear::<AVX2>(&texture.levels[self.level], self.level, u, v, shift, weight - coarse, out);
            if coarse > 0 {
                let next = self.level + 1;
                bilinear::<AVX2>(&texture.levels[next], next, u, v, shift, coarse, out);
            }
        }
        for o in out.iter_mut() {
            *o /= WEIGHT_ONE;
        }
    }
}

impl Level {
    /// Two texels beside each other in the low bytes, of the upper and of the lower row, at places in 1/256 texels; 0 outside.
    #[inline(always)]
    fn pairs<const AVX2: bool>(&self, px: &[i32; BLOCK], py: &[i32; BLOCK]) -> ([i32; BLOCK], [i32; BLOCK]) {
        #[cfg(target_arch = "x86_64")]
        if AVX2 {
            #[allow(unsafe_code)]
            // SAFETY: only the passes that were compiled for AVX2, on a processor that has it, ask for it.
            return unsafe { self.pairs_avx2(px, py) };
        }
        let (mut upper, mut lower) = ([0; BLOCK], [0; BLOCK]);
        for i in 0..BLOCK {
            let o = (py[i] >> 8) as usize * self.stride + (px[i] >> 8) as usize;
            if let Some(t) = self.texels.get(o..o + self.stride + 2) {
                upper[i] = i32::from(u16::from_le_bytes([t[0], t[1]]));
                lower[i] = i32::from(u16::from_le_bytes([t[self.stride], t[self.stride + 1]]));
            }
        }
        (upper, lower)
    }

    /// As [`Level::pairs`], eight at once; above the pair each has two more texels.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    #[inline]
    #[allow(unsafe_code)]
    fn pairs_avx2(&self, px: &[i32; BLOCK], py: &[i32; BLOCK]) -> ([i32; BLOCK], [i32; BLOCK]) {
        use std::arch::x86_64::{
            __m256i, _mm256_add_epi32, _mm256_and_si256, _mm256_cmpgt_epi32, _mm256_loadu_si256,
            _mm256_mask_i32gather_epi32, _mm256_mullo_epi32, _mm256_set1_epi32, _mm256_setzero_si256,
            _mm256_srai_epi32, _mm256_storeu_si256,
        };
        let (mut upper, mut lower) = ([0; BLOCK], [0; BLOCK]);
        // Four bytes are read from each row: that is two more than the pair, which a level has added at its end.
        let end = self.texels.len() as i32 - self.stride as i32 - 3;
        let (least, end) = (_mm256_set1_epi32(-1), _mm256_set1_epi32(end));
        let (none, stride) = (_mm256_setzero_si256(), _mm256_set1_epi32(self.stride as i32));
        for i in (0..BLOCK).step_by(8) {
            // SAFETY: eight values are left in each array. What is gathered lies between the first and the last texel: elsewhere the
            // mask is not set, and nothing is read.
            unsafe {
                let x = _mm256_srai_epi32::<8>(_mm256_loadu_si256(px[i..].as_ptr().cast::<__m256i>()));
                let y = _mm256_srai_epi32::<8>(_mm256_loadu_si256(py[i..].as_ptr().cast::<__m256i>()));
                let o = _mm256_add_epi32(_mm256_mullo_epi32(y, stride), x);
                let inside = _mm256_and_si256(_mm256_cmpgt_epi32(o, least), _mm256_cmpgt_epi32(end, o));
                let first = self.texels.as_ptr();
                let above = _mm256_mask_i32gather_epi32::<1>(none, first.cast(), o, inside);
                let below = _mm256_mask_i32gather_epi32::<1>(none, first.add(self.stride).cast(), o, inside);
                _mm256_storeu_si256(upper[i..].as_mut_ptr().cast::<__m256i>(), above);
                _mm256_storeu_si256(lower[i..].as_mut_ptr().cast::<__m256i>(), below);
            }
        }
        (upper, lower)
    }
}

/// Adds one bilinear lookup of a level to each pixel of a block.
#[inline(always)]
fn bilinear<const AVX2: bool>(
    level: &Level,
    index: usize,
    u: &[f32; BLOCK],
    v: &[f32; BLOCK],
    shift: (f32, f32),
    weight: i32,
    out: &mut [i32; BLOCK],
) {
    // Adding 1.5 * 2^23 leaves the rounded integer in the low bits (for less than 2^22 in size).
    const MAGIC: f32 = 12_582_912.0;
    let scale = 256.0 / (1u32 << index) as f32;
    let (high_x, high_y) = ((level.width * 256) as f32, (level.height * 256) as f32);
    let (mut px, mut py) = ([0i32; BLOCK], [0i32; BLOCK]);
    for i in 0..BLOCK {
        // The border of one texel shifts by +1, the texel centre by -1/2.
        let x = ((u[i] + shift.0) * scale + 128.0).clamp(0.0, high_x);
        let y = ((v[i] + shift.1) * scale + 128.0).clamp(0.0, high_y);
        px[i] = (x + MAGIC).to_bits() as i32 - MAGIC.to_bits() as i32;
        py[i] = (y + MAGIC).to_bits() as i32 - MAGIC.to_bits() as i32;
    }
    let (upper, lower) = level.pairs::<AVX2>(&px, &py);
    for i in 0..BLOCK {
        let (fx, fy) = (px[i] & 255, py[i] & 255);
        let (a, b) = (upper[i] & 255, upper[i] >> 8 & 255);
        let (c, d) = (lower[i] & 255, lower[i] >> 8 & 255);
        let top = (a << 8) + (b - a) * fx;
        let bottom = (c << 8) + (d - c) * fx;
        let value = ((top << 8) + (bottom - top) * fy) >> 8;
        out[i] += value * weight;
    }
}

impl Filter {
    /// Looks up one place; the result is 256 times the grey level.
    #[inline(always)]
    pub fn one(&self, texture: &Texture, u: f32, v: f32) -> i32 {
        let mut sum = 0;
        for tap in 0..self.taps {
            let k = tap as f32 - 0.5 * (self.taps - 1) as f32;
            let (x, y) = (u + k * self.step.0, v + k * self.step.1);
            let fine = single(&texture.levels[self.level], self.level, x, y);
            let value = if self.next > 0 {
                let coarse = single(&texture.levels[self.level + 1], self.level + 1, x, y);
                fine + (coarse - fine) * self.next / WEIGHT_ONE
            } else {
                fine
            };
            sum += value;
        }
        sum / self.taps
    }
}

/// One bilinear lookup; 256 times the grey level.
#[inline(always)]
fn single(level: &Level, index: usize, u: f32, v: f32) -> i32 {
    let scale = 256.0 / (1u32 << index) as f32;
    let x = (u * scale + 128.5).clamp(0.0, (level.width * 256) as f32) as i32;
    let y = (v * scale + 128.5).clamp(0.0, (level.height * 256) as f32) as i32;
    let o = (y >> 8) as usize * level.stride + (x >> 8) as usize;
    let Some(t) = level.texels.get(o..o + level.stride + 2) else { return 0 };
    let (fx, fy) = (x & 255, y & 255);
    let (a, b) = (i32::from(t[0]), i32::from(t[1]));
    let (c, d) = (i32::from(t[level.stride]), i32::from(t[level.stride + 1]));
    let top = (a << 8) + (b - a) * fx;
    let bottom = (c << 8) + (d - c) * fx;
    ((top << 8) + (bottom - top) * fy) >> 8
}
