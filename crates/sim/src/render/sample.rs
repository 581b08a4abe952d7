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
    pub fn block(&self, texture: &Texture, u: &[f32; BLOCK], v: &[f32; BLOCK], out: &mut [i32; BLOCK]) {
        *out = [0; BLOCK];
        let tap_weight = WEIGHT_ONE / self.taps;
        let rest = WEIGHT_ONE - tap_weight * self.taps;
        for tap in 0..self.taps {
            let weight = if tap == self.taps / 2 { tap_weight + rest } else { tap_weight };
            let k = tap as f32 - 0.5 * (self.taps - 1) as f32;
            let (su, sv) = (k * self.step.0, k * self.step.1);
            let coarse = weight * self.next / WEIGHT_ONE;
            bilinear(&texture.levels[self.level], self.level, u, v, (su, sv), weight - coarse, out);
            if coarse > 0 {
                bilinear(&texture.levels[self.level + 1], self.level + 1, u, v, (su, sv), coarse, out);
            }
        }
        for o in out.iter_mut() {
            *o /= WEIGHT_ONE;
        }
    }
}

/// Adds one bilinear lookup of a level to each pixel of a block.
#[inline(always)]
fn bilinear(
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
    let stride = level.stride;
    let mut quad = [[0u8; BLOCK]; 4];
    for i in 0..BLOCK {
        let o = (py[i] >> 8) as usize * stride + (px[i] >> 8) as usize;
        if let Some(t) = level.texels.get(o..o + stride + 2) {
            quad[0][i] = t[0];
            quad[1][i] = t[1];
            quad[2][i] = t[stride];
            quad[3][i] = t[stride + 1];
        }
    }
    for i in 0..BLOCK {
        let (fx, fy) = (px[i] & 255, py[i] & 255);
        let (a, b) = (i32::from(quad[0][i]), i32::from(quad[1][i]));
        let (c, d) = (i32::from(quad[2][i]), i32::from(quad[3][i]));
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
