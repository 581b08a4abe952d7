//! Least and greatest depth over squares of pixels, each level half the resolution of the one before.
//!
//! A block of voxels is compared with the few squares that its projection covers; for most blocks that decides the
//! matter.

use crate::Backend;
use crate::backend::dispatch;
use crate::pixel::{WEIGHT_BITS, weight_of};

/// The level whose squares have eight pixels a side: the finest one that blocks are compared with.
pub(crate) const TILE_LEVEL: usize = 3;
/// Rows of pixels that are added at once: those of a row of tiles.
pub(crate) const STRIP: usize = 1 << TILE_LEVEL;

/// Squares of `2^level` pixels a side; those at the right and lower border may extend past the image.
#[derive(Clone, Debug, Default)]
pub(crate) struct Level {
    pub width: usize,
    pub height: usize,
    /// Least depth of the pixels that have one; infinite where none does.
    pub least: Vec<f32>,
    /// Greatest depth; 0 where no pixel has one.
    pub greatest: Vec<f32>,
    /// The least depth where at least half of the pixels of every eight-pixel square have one, else 0: space nearer
    /// than this may be called free for the whole square. Empty below [`TILE_LEVEL`].
    pub sure: Vec<f32>,
}

/// All levels from 1 to the one with a single square.
#[derive(Clone, Debug, Default)]
pub(crate) struct DepthPyramid {
    levels: Vec<Level>,
    /// Number of pixels with a depth in each square of the rows that were added last, up to the tile level.
    seen: Vec<Vec<u8>>,
}

impl DepthPyramid {
    /// Level 1 and up; level 0 is the image itself.
    pub fn level(&self, level: usize) -> &Level {
        &self.levels[level.clamp(1, self.levels.len()) - 1]
    }

    /// Index of the coarsest level.
    pub fn top(&self) -> usize {
        self.levels.len()
    }

    /// Least and greatest depth of the image.
    pub fn range_m(&self) -> Option<(f32, f32)> {
        let top = self.levels.last()?;
        let least = top.least.iter().copied().fold(f32::INFINITY, f32::min);
        let greatest = top.greatest.iter().copied().fold(0.0, f32::max);
        (greatest > 0.0).then_some((least, greatest))
    }

    /// Builds the pyramid of an image's pixels.
    pub fn build(&mut self, pixels: &[u32], width: usize, height: usize, backend: Backend) {
        let this = self;
        dispatch!(backend, build(this: &mut DepthPyramid, pixels: &[u32], width: usize, height: usize) -> ());
    }

    /// Begins an image of this size.
    #[inline(always)]
    pub fn begin(&mut self, width: usize, height: usize) {
        let mut count = TILE_LEVEL;
        while (1 << count) < width.max(height) {
            count += 1;
        }
        self.levels.resize_with(count, Level::default);
        let (mut finer_width, mut finer_height) = (width, height);
        for (i, level) in self.levels.iter_mut().enumerate() {
            level.reset(finer_width, finer_height, i + 1 >= TILE_LEVEL);
            (finer_width, finer_height) = (level.width, level.height);
        }
        let levels = self.levels.iter();
        self.seen.resize_with(TILE_LEVEL, Vec::new);
        for ((seen, level), rows) in self.seen.iter_mut().zip(levels).zip([4, 2, 1]) {
            seen.resize(rows * level.width, 0);
        }
    }

    /// Adds rows of an image of this width: [`STRIP`] of them from a multiple of that on, fewer at its end. Returns how many of their pixels
    /// have a depth.
    #[inline(always)]
    pub fn add(&mut self, pixels: &[u32], y: usize, width: usize) -> usize {
        let Self { levels, seen } = self;
        let [seen_1, seen_2, seen_3] = &mut seen[..] else { return 0 };
        let [one, two, three] = &mut levels[..TILE_LEVEL] else { return 0 };
        let (w1, w2, w3) = (one.width, two.width, three.width);
        // The rows of a level, from this strip's first.
        let h1 = (pixels.len() / width).div_ceil(2);
        let (h2, h3) = (h1.div_ceil(2), h1.div_ceil(2).div_ceil(2));
        let at = |level: usize, w: usize, h: usize| (y >> level) * w..((y >> level) + h) * w;
        let (at_1, at_2, at_3) = (at(1, w1, h1), at(2, w2, h2), at(3, w3, h3));
        let (least, greatest) = (&mut one.least[at_1.clone()], &mut one.greatest[at_1.clone()]);
        let (seen_1, seen_2, seen_3) =
            (&mut seen_1[..h1 * w1], &mut seen_2[..h2 * w2], &mut seen_3[..h3 * w3]);
        first(least, greatest, seen_1, w1, pixels, width);
        halve(&one.least[at_1.clone()], w1, &mut two.least[at_2.clone()], w2, f32::INFINITY, lesser);
        halve(&one.greatest[at_1], w1, &mut two.greatest[at_2.clone()], w2, 0.0, greater);
        halve(seen_1, w1, seen_2, w2, 0, |a, b| a + b);
        halve(&two.least[at_2.clone()], w2, &mut three.least[at_3.clone()], w3, f32::INFINITY, lesser);
        halve(&two.greatest[at_2], w2, &mut three.greatest[at_3.clone()], w3, 0.0, greater);
        halve(seen_2, w2, seen_3, w3, 0, |a, b| a + b);
        let tiles = three.least[at_3.clone()].iter().zip(&*seen_3);
        for (sure, (&least, &seen)) in three.sure[at_3].iter_mut().zip(tiles) {
            *sure = if seen >= 32 { least } else { 0.0 };
        }
        seen_3.iter().map(|&seen| usize::from(seen)).sum()
    }

    /// Ends the image of which all rows were added.
    #[inline(always)]
    pub fn end(&mut self) {
        for i in TILE_LEVEL..self.levels.len() {
            let (below, rest) = self.levels.split_at_mut(i);
            let (from, to) = (&below[i - 1], &mut rest[0]);
            halve(&from.least, from.width, &mut to.least, to.width, f32::INFINITY, lesser);
            halve(&from.greatest, from.width, &mut to.greatest, to.width, 0.0, greater);
            halve(&from.sure, from.width, &mut to.sure, to.width, f32::INFINITY, lesser);
        }
    }
}

#[inline(always)]
fn build(pyramid: &mut DepthPyramid, pixels: &[u32], width: usize, height: usize) {
    pyramid.begin(width, height);
    for (i, rows) in pixels.chunks(STRIP * width).enumerate() {
        pyramid.add(rows, i * STRIP, width);
    }
    pyramid.end();
}

/// The lesser of two numbers; neither is NaN.
#[inline(always)]
pub(crate) fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The greater of two numbers; neither is NaN.
#[inline(always)]
pub(crate) fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Level {
    fn reset(&mut self, finer_width: usize, finer_height: usize, sure: bool) {
        (self.width, self.height) = (finer_width.div_ceil(2), finer_height.div_ceil(2));
        let squares = self.width * self.height;
        self.least.resize(squares, 0.0);
        self.greatest.resize(squares, 0.0);
        self.sure.resize(if sure { squares } else { 0 }, 0.0);
    }
}

/// Rows of level 1 from those of the pixels, and how many of each four have a depth.
#[inline(always)]
fn first(
    least: &mut [f32],
    greatest: &mut [f32],
    seen: &mut [u8],
    half_width: usize,
    pixels: &[u32],
    width: usize,
) {
    // Depths are not negative, so their bit patterns have the same order.
    let near = |p: u32| if weight_of(p) > 0 { p & !WEIGHT_BITS } else { f32::INFINITY.to_bits() };
    let far = |p: u32| if weight_of(p) > 0 { p & !WEIGHT_BITS } else { 0 };
    let has = |p: u32| u8::from(weight_of(p) > 0);
    let outs = (least.chunks_exact_mut(half_width).zip(greatest.chunks_exact_mut(half_width)))
        .zip(seen.chunks_exact_mut(half_width));
    for (((least, greatest), seen), rows) in outs.zip(pixels.chunks(2 * width)) {
        let (upper, lower) = rows.split_at(width);
        let (lower, twice) = if lower.is_empty() { (upper, 0) } else { (lower, 1) };
        let outs = least.iter_mut().zip(greatest.iter_mut()).zip(seen.iter_mut());
        for (((l, g), c), (a, b)) in outs.zip(upper.chunks_exact(2).zip(lower.chunks_exact(2))) {
            *l = f32::from_bits(near(a[0]).min(near(a[1])).min(near(b[0]).min(near(b[1]))));
            *g = f32::from_bits(far(a[0]).max(far(a[1])).max(far(b[0]).max(far(b[1]))));
            *c = has(a[0]) + has(a[1]) + twice * (has(b[0]) + has(b[1]));
        }
        if width % 2 == 1 {
            let (a, b, i) = (upper[width - 1], lower[width - 1], half_width - 1);
            least[i] = f32::from_bits(near(a).min(near(b)));
            greatest[i] = f32::from_bits(far(a).max(far(b)));
            seen[i] = has(a) + twice * has(b);
        }
    }
}

/// Joins each four squares into one; what lies beyond the border counts as `outside`.
#[inline(always)]
fn halve<T: Copy>(
    from: &[T],
    from_width: usize,
    to: &mut [T],
    to_width: usize,
    outside: T,
    join: impl Fn(T, T) -> T + Copy,
) {
    let from_height = from.len() / from_width;
    for (y, out) in to.chunks_exact_mut(to_width).enumerate() {
        let upper = &from[2 * y * from_width..(2 * y + 1) * from_width];
        if 2 * y + 1 < from_height {
            let lower = &from[(2 * y + 1) * from_width..(2 * y + 2) * from_width];
            for (o, (a, b)) in out.iter_mut().zip(upper.chunks_exact(2).zip(lower.chunks_exact(2))) {
                *o = join(join(a[0], a[1]), join(b[0], b[1]));
            }
            if from_width % 2 == 1 {
                let last = join(upper[from_width - 1], lower[from_width - 1]);
                out[to_width - 1] = join(last, outside);
            }
        } else {
            for (o, a) in out.iter_mut().zip(upper.chunks(2)) {
                *o = join(join(a[0], a.get(1).copied().unwrap_or(outside)), outside);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pixel::depth_of;

    #[test]
    fn every_level_holds_the_least_and_greatest_of_its_pixels() {
        let (w, h) = (37, 22);
        let pixel = |i: usize| {
            let d = 0.5 + ((i * 7919) % 1000) as f32 / 200.0;
            if i.is_multiple_of(11) { 0 } else { (d.to_bits() & !WEIGHT_BITS) | 3 }
        };
        let pixels: Vec<u32> = (0..w * h).map(pixel).collect();
        let mut pyramid = DepthPyramid::default();
        pyramid.build(&pixels, w, h, Backend::best());
        for l in 1..=pyramid.top() {
            let (level, size) = (pyramid.level(l), 1 << l);
            for (i, (&least, &greatest)) in level.least.iter().zip(&level.greatest).enumerate() {
                let (x0, y0) = (i % level.width * size, i / level.width * size);
                let inside =
                    (y0..h.min(y0 + size)).flat_map(|y| (x0..w.min(x0 + size)).map(move |x| y * w + x));
                let depths: Vec<f32> =
                    inside.map(|p| pixels[p]).filter(|&p| weight_of(p) > 0).map(depth_of).collect();
                assert_eq!(least, depths.iter().copied().fold(f32::INFINITY, f32::min));
                assert_eq!(greatest, depths.iter().copied().fold(0.0, f32::max));
            }
        }
    }

    #[test]
    fn squares_with_mostly_no_depth_are_not_sure() {
        let one = (2.0f32.to_bits() & !WEIGHT_BITS) | 1;
        let pixels: Vec<u32> = (0..256).map(|i| if i % 16 < 8 || i % 16 == 12 { one } else { 0 }).collect();
        let mut pyramid = DepthPyramid::default();
        pyramid.build(&pixels, 16, 16, Backend::best());
        assert_eq!(pyramid.level(3).sure, [2.0, 0.0, 2.0, 0.0]);
        assert_eq!(pyramid.level(4).sure, [0.0]);
        assert_eq!(pyramid.range_m(), Some((2.0, 2.0)));
    }
}
