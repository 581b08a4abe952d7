//! From the rows of a depth image to pixels with a weight: what is out of range or an edge is dropped, and noise and the slant of the
//! surface weigh.

use super::DepthConfig;
use crate::Backend;
use crate::frame::DepthFrame;
use crate::pixel::{WEIGHT_BITS, depth_of};
use crate::pyramid::{self, greater};
use crate::submap::Rows;
use cairn_sensor::Camera;

/// What a pixel of an image says.
pub(super) trait Measured: Copy {
    /// Metres, with `scale` metres a unit; 0 for none.
    fn metres(self, scale: f32) -> f32;
}

impl Measured for u16 {
    #[inline(always)]
    fn metres(self, scale: f32) -> f32 {
        // 65535 means no depth, however short the unit.
        if self == u16::MAX { 0.0 } else { f32::from(self) * scale }
    }
}

impl Measured for f32 {
    #[inline(always)]
    fn metres(self, _: f32) -> f32 {
        self
    }
}

/// From metres to pixels with a weight.
#[derive(Clone, Copy)]
pub(super) struct Words {
    range: [f32; 2],
    floor: f32,
    growth: f32,
    from: f32,
    /// The variance between images.
    between: f32,
    /// 31 times the least variance.
    greatest: f32,
}

impl Words {
    #[inline(always)]
    pub(super) fn new(config: &DepthConfig) -> Self {
        let noise = &config.noise;
        let (floor, between_m) = (noise.floor_m as f32, config.between_m as f32);
        let between = between_m * between_m;
        Self {
            range: [config.nearest_m as f32, config.farthest_m as f32],
            floor,
            between,
            greatest: 31.0 * (between + floor * floor),
            growth: noise.growth as f32,
            from: noise.nearest_m as f32,
        }
    }

    /// The pixel of a depth, with its weight; [`NONE`] for one out of range.
    #[inline(always)]
    pub(super) fn of(&self, z: f32) -> u32 {
        let past = z - self.from;
        let sigma = self.floor + self.growth * (past * past);
        // Weights go down to 1/31 of the greatest; adding 2^23 rounds and leaves the integer in the lowest bits.
        let weight = (self.greatest / (self.between + sigma * sigma)).max(1.0) + 8_388_608.0;
        let pixel = (z.to_bits() & !WEIGHT_BITS) | (weight.to_bits() & WEIGHT_BITS);
        // False for NaN.
        if (z >= self.range[0]) & (z <= self.range[1]) { pixel } else { NONE }
    }
}

/// A pixel without depth while edges are looked for: greater than any other as a number without a sign, less than any with one.
pub(super) const NONE: u32 = 1 << 31;

/// Gives the pixels of an image row by row.
trait RowSource {
    /// The next row, which is the `y`-th; `None` where there is none.
    fn next_row(&mut self, y: usize, out: &mut [u32]) -> Option<()>;
}

struct ImageRows<'a, T> {
    words: Words,
    scale: f32,
    data: &'a [T],
    remap: &'a [u32],
}

impl<T: Measured> RowSource for ImageRows<'_, T> {
    #[inline(always)]
    fn next_row(&mut self, y: usize, out: &mut [u32]) -> Option<()> {
        let Self { words, scale, data, remap } = *self;
        let width = out.len();
        if remap.is_empty() {
            for (o, v) in out.iter_mut().zip(&data[y * width..]) {
                *o = words.of(v.metres(scale));
            }
        } else {
            for (o, &i) in out.iter_mut().zip(&remap[y * width..]) {
                *o = data.get(i as usize).map_or(NONE, |v| words.of(v.metres(scale)));
            }
        }
        Some(())
    }
}

struct PackedRows<'a, 'b> {
    packed: &'a mut Rows<'b>,
    table: &'a [u32; 1 << 16],
    backend: Backend,
}

impl RowSource for PackedRows<'_, '_> {
    #[inline(always)]
    fn next_row(&mut self, _: usize, out: &mut [u32]) -> Option<()> {
        self.packed.next(self.backend)?;
        self.packed.pixels(self.backend, out, self.table, NONE);
        Some(())
    }
}

#[inline(always)]
pub(super) fn from_units(
    packing: Packing,
    scale: f32,
    data: &[u16],
    remap: &[u32],
    rows: &mut [u32],
    frame: &mut DepthFrame,
) -> usize {
    let source = ImageRows { words: Words::new(packing.config), scale, data, remap };
    pack(packing, rows, frame, source).unwrap_or(0)
}

#[inline(always)]
pub(super) fn from_metres(
    packing: Packing,
    data: &[f32],
    remap: &[u32],
    rows: &mut [u32],
    frame: &mut DepthFrame,
) -> usize {
    let source = ImageRows { words: Words::new(packing.config), scale: 1.0, data, remap };
    pack(packing, rows, frame, source).unwrap_or(0)
}

#[inline(always)]
pub(super) fn from_packed(
    packing: Packing,
    packed: &mut Rows,
    table: &[u32; 1 << 16],
    rows: &mut [u32],
    frame: &mut DepthFrame,
    backend: Backend,
) -> Option<usize> {
    let valid = pack(packing, rows, frame, PackedRows { packed: &mut *packed, table, backend })?;
    packed.end().map(|()| valid)
}

/// How pixels are packed.
#[derive(Clone, Copy)]
pub(super) struct Packing<'a> {
    pub config: &'a DepthConfig,
    /// Whether weights follow the slant of the surface.
    pub slanted: bool,
}

/// Rows that are looked at together, and share the slant of one of them.
const STRIP: usize = 4;
/// Rows that are kept: those of a strip, the one above it, and the one below.
pub(super) const ROWS: usize = 8;
/// Pixels on each side that the slope of a surface is found from.
pub(super) const REACH: usize = 2;

/// Drops the edges of an image, which comes row by row, weights what is left by its slant, counts it, and builds its pyramid; `None`
/// where a row does not come. `rows` holds [`ROWS`] rows with [`REACH`] pixels of border at both ends.
#[inline(always)]
fn pack(
    packing: Packing,
    rows: &mut [u32],
    frame: &mut DepthFrame,
    mut source: impl RowSource,
) -> Option<usize> {
    let Packing { config, slanted } = packing;
    let DepthFrame { camera, pixels, pyramid, .. } = frame;
    let Camera { width, height, .. } = *camera;
    let stride = width + 2 * REACH;
    let mut slants = vec![1.0; width];
    rows.fill(NONE);
    pyramid.begin(width, height);
    let (mut valid, mut read) = (0, 0);
    for strip in (0..height).step_by(STRIP) {
        while read <= strip + STRIP {
            let row = &mut rows[read % ROWS * stride..][..stride][REACH..][..width];
            if read < height {
                source.next_row(read, row)?;
            } else {
                row.fill(NONE);
            }
            read += 1;
        }
        let row = |y: usize| &rows[y % ROWS * stride..][..stride];
        // The second of its rows, so that the one above the strip and its last are those that are needed.
        let of = strip + 1;
        if slanted {
            slant_row(config, camera, of, [of + ROWS - REACH, of, of + REACH].map(row), &mut slants);
        }
        for y in strip..(strip + STRIP).min(height) {
            let around = [y + ROWS - 1, y, y + 1].map(row);
            let out = &mut pixels[y * width..][..width];
            if slanted {
                pack_row::<true>(config, around, &slants, out);
            } else {
                pack_row::<false>(config, around, &slants, out);
            }
        }
        // While they are at hand.
        let end = (strip + STRIP).min(height);
        if end % pyramid::STRIP == 0 || end == height {
            let from = (end - 1) / pyramid::STRIP * pyramid::STRIP;
            valid += pyramid.add(&pixels[from * width..end * width], from, width);
        }
    }
    pyramid.end();
    Some(valid)
}

/// A pixel with so much of its weight, at least 1.
#[inline(always)]
fn times(pixel: u32, slant: f32) -> u32 {
    // Adding 2^23 rounds and leaves the integer in the lowest bits.
    let weight = greater((pixel & WEIGHT_BITS) as i32 as f32 * slant, 1.0) + 8_388_608.0;
    (pixel & !WEIGHT_BITS) | (weight.to_bits() & WEIGHT_BITS)
}

/// What the weights of a row's pixels are multiplied by, 1 at most.
///
/// What images differ by across a surface moves its depth by one over the product of its normal with the ray (of length 1 along the
/// optical axis): a depth has so much more variance where its surface is seen at a slant. Curless and Levoy (1996) weight by the cosine.
#[inline(always)]
fn slant_row(
    config: &DepthConfig,
    camera: &Camera,
    y: usize,
    [above, here, below]: [&[u32]; 3],
    out: &mut [f32],
) {
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v as f32);
    let width = out.len();
    let (before, after) = (&here[..width], &here[2 * REACH..][..width]);
    let [above, here, below] = [above, here, below].map(|row| &row[REACH..][..width]);
    let v = y as f32 - cy;
    for x in 0..width {
        let z = depth_of(here[x]);
        let edge = REACH as f32 * greater(share * z, least);
        let by_u = slope(z - depth_of(before[x]), depth_of(after[x]) - z, edge);
        let by_v = slope(z - depth_of(above[x]), depth_of(below[x]) - z, edge);
        // The normal is (fx dz/du, fy dz/dv, -z - u dz/du - v dz/dv); times the ray it is -z.
        let normal = [fx * by_u, fy * by_v, z + (x as f32 - cx) * by_u + v * by_v];
        let square = normal.iter().map(|n| n * n).sum::<f32>();
        out[x] = if here[x] != NONE && z * z < square { z * z / square } else { 1.0 };
    }
}

/// Change of depth a pixel, from those to the pixels at [`REACH`] on both sides: the lesser, since an edge lies on one side; none where
/// both sides are edges or have no depth.
#[inline(always)]
fn slope(before: f32, after: f32, edge: f32) -> f32 {
    let lesser = if before.abs() < after.abs() { before } else { after };
    if lesser.abs() <= edge { lesser * (1.0 / REACH as f32) } else { 0.0 }
}

#[inline(always)]
fn pack_row<const SLANTED: bool>(
    config: &DepthConfig,
    [up, here, down]: [&[u32]; 3],
    slants: &[f32],
    out: &mut [u32],
) {
    let [share, least] = [config.edge_share as f32, config.edge_m as f32];
    let width = out.len();
    let (left, right) = (&here[REACH - 1..][..width], &here[REACH + 1..][..width]);
    let (here, up, down) = (&here[REACH..][..width], &up[REACH..][..width], &down[REACH..][..width]);
    let slants = &slants[..width];
    for x in 0..width {
        let z = depth_of(here[x]);
        // A neighbour without depth is neither of them, and makes no edge. Weights follow depths: of equal depths they are equal.
        let around = [left[x], right[x], up[x], down[x]];
        let nearest = around.iter().fold(here[x], |nearest, &n| nearest.min(n));
        let farthest = around.iter().fold(here[x] as i32, |farthest, &n| farthest.max(n as i32));
        let jump = greater(z - depth_of(nearest), depth_of(farthest as u32) - z);
        let keep = jump <= greater(share * z, least);
        // Without its sign no depth is 0.
        let pixel = if SLANTED { times(here[x], slants[x]) } else { here[x] & !NONE };
        out[x] = if keep & (!SLANTED | (here[x] != NONE)) { pixel } else { 0 };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DepthPreparer;
    use crate::pixel::weight_of;
    use cairn_sensor::Image;

    /// Pixels of a plane through (0, 0, 2) weigh as much less as the square of the cosine says; beside an edge, too.
    #[test]
    fn what_is_seen_at_a_slant_weighs_less() {
        let camera = Camera::pinhole(64, 48, 60.0, 60.0, 31.5, 23.5);
        let mut preparer = DepthPreparer::new(DepthConfig::default(), camera, 0.001).expect("a camera");
        let noise = DepthConfig::default().noise;
        let mut seen = [0, 0];
        for normal in [[0.0, 0.0, 1.0f64], [0.6, 0.0, 0.8], [0.0, -0.8, 0.6], [0.6, 0.6, 0.53]] {
            let length = normal.iter().map(|v| v * v).sum::<f64>().sqrt();
            let ray = |i: usize| [((i % 64) as f64 - 31.5) / 60.0, ((i / 64) as f64 - 23.5) / 60.0, 1.0];
            let along = |i: usize| (0..3).map(|k| ray(i)[k] * normal[k]).sum::<f64>();
            // The right half is a wall far behind it.
            let depth = |i: usize| if i % 64 < 32 { (2.0 * normal[2] / along(i)) as f32 } else { 4.5 };
            let image = Image::from_vec(64, 48, (0..64 * 48).map(depth).collect()).expect("all pixels");
            let frame = preparer.prepare_metres(&image).expect("depth");
            // The borders' slopes are those of one side.
            for i in (0..64 * 48).filter(|i| i % 64 < 32) {
                let (pixel, z) = (frame.pixels[i], f64::from(depth(i)));
                if weight_of(pixel) == 0 {
                    continue;
                }
                let variance = |sigma: f64| DepthConfig::default().between_m.powi(2) + sigma * sigma;
                let slant = along(i) / length;
                let head_on = 31.0 * variance(noise.floor_m) / variance(noise.sigma_m(z));
                let (expected, found) = (head_on * (slant * slant).min(1.0), f64::from(weight_of(pixel)));
                // Rounded twice; the slope over two pixels is that of a chord, and of one row for four.
                let off = (found - expected.max(1.0)).abs();
                assert!(off <= 1.01 + 0.15 * expected, "{normal:?} {i}: {found} {expected}");
                seen[0] += 1;
                seen[1] += usize::from(expected < 0.5 * head_on && head_on > 6.0);
            }
        }
        assert!(seen[0] > 3000 && seen[1] > 500, "{seen:?}");
    }
}
