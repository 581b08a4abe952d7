//! A texture as a chain of halved images, each with a border of one texel so that bilinear reads need no test, and each texel
//! beside the one below it, so that the four of a bilinear read lie together.
//!
//! Level 0 texel `i` covers `i..i+1` texel units; level `l` texel `i` covers `i * 2^l .. (i + 1) * 2^l`, so a
//! point keeps its place at every level and only its sharpness changes.

/// One level, border included.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    /// Width without border, in texels.
    pub width: usize,
    /// Height without border, in texels.
    pub height: usize,
    /// Pairs from row to row.
    pub stride: usize,
    /// Texels and the ones below them: `height + 1` rows of `width + 2`.
    pub pairs: Vec<[u8; 2]>,
    /// Units of 1/256 texel in a texel of level 0.
    pub scale: f32,
}

/// A mip chain.
#[derive(Clone, Debug)]
pub(crate) struct Texture {
    /// Finest first.
    pub levels: Vec<Level>,
}

/// The largest side of a texture in texels: the fixed-point coordinates of the sampler hold no more.
pub(crate) const MAX_SIDE: usize = 8192;

impl Texture {
    /// From rows of texels; builds the chain down to one texel.
    pub fn new(width: usize, height: usize, texels: &[u8]) -> Self {
        let mut levels = vec![Level::bordered(width, height, texels, 256.0)];
        while let Some(last) = levels.last() {
            if last.width <= 1 && last.height <= 1 {
                break;
            }
            let next = last.half();
            levels.push(next);
        }
        Self { levels }
    }
}

impl Level {
    fn bordered(width: usize, height: usize, inner: &[u8], scale: f32) -> Self {
        assert!(width.max(height) <= MAX_SIDE, "a texture of {width}x{height}");
        let stride = width + 2;
        let row = |y: usize| &inner[(y.clamp(1, height) - 1) * width..][..width];
        let mut pairs = Vec::with_capacity(stride * (height + 1));
        for y in 0..=height {
            let (upper, lower) = (row(y), row(y + 1));
            pairs.push([upper[0], lower[0]]);
            pairs.extend(upper.iter().zip(lower).map(|(a, b)| [*a, *b]));
            pairs.push([upper[width - 1], lower[width - 1]]);
        }
        Self { width, height, stride, pairs, scale }
    }

    /// Averages 2x2 blocks; an odd last row or column counts twice.
    fn half(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut inner = vec![0u8; width * height];
        for (y, out) in inner.chunks_exact_mut(width).enumerate() {
            // The border repeats the last texel, so the odd case reads the border.
            let blocks = self.pairs[(2 * y + 1) * self.stride + 1..][..2 * width].chunks_exact(2);
            for (o, block) in out.iter_mut().zip(blocks) {
                *o = ((block.as_flattened().iter().map(|t| u16::from(*t)).sum::<u16>() + 2) >> 2) as u8;
            }
        }
        Self::bordered(width, height, &inner, 0.5 * self.scale)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_keeps_mean_and_odd_edge() {
        let t = Texture::new(3, 2, &[10, 20, 30, 30, 40, 50]);
        assert_eq!(t.levels.len(), 3);
        let l1 = &t.levels[1];
        assert_eq!((l1.width, l1.height), (2, 1));
        assert_eq!(&l1.pairs[l1.stride + 1..l1.stride + 3], &[[25, 25], [40, 40]]);
        assert_eq!(t.levels[2].pairs[4], [33, 33]);
    }
}
