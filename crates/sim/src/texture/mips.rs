//! A texture as a chain of halved images, each with a border of one texel so that bilinear reads need no test.
//!
//! Level 0 texel `i` covers `i..i+1` texel units; level `l` texel `i` covers `i * 2^l .. (i + 1) * 2^l`, so a
//! point keeps its place at every level and only its sharpness changes.

/// One level: `(width + 2) * (height + 2)` texels, border included.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    /// Width without border, in texels.
    pub width: usize,
    /// Height without border, in texels.
    pub height: usize,
    /// Bytes from row to row.
    pub stride: usize,
    /// The texels, border included, and two bytes more: four are read at once.
    pub texels: Vec<u8>,
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
        let mut levels = vec![Level::bordered(width, height, texels)];
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
    fn bordered(width: usize, height: usize, inner: &[u8]) -> Self {
        let stride = width + 2;
        let mut texels = vec![0u8; stride * (height + 2) + 2];
        for y in 0..height + 2 {
            let source = y.clamp(1, height) - 1;
            let row = &inner[source * width..(source + 1) * width];
            let out = &mut texels[y * stride..(y + 1) * stride];
            out[1..=width].copy_from_slice(row);
            out[0] = row[0];
            out[width + 1] = row[width - 1];
        }
        Self { width, height, stride, texels }
    }

    /// Averages 2x2 blocks; an odd last row or column counts twice.
    fn half(&self) -> Self {
        let (width, height) = (self.width.div_ceil(2), self.height.div_ceil(2));
        let mut inner = vec![0u8; width * height];
        for y in 0..height {
            // The border repeats the last texel, so the odd case reads the border.
            let top = &self.texels[(2 * y + 1) * self.stride + 1..][..2 * width];
            let bottom = &self.texels[(2 * y + 2) * self.stride + 1..][..2 * width];
            let out = &mut inner[y * width..(y + 1) * width];
            for ((o, t), b) in out.iter_mut().zip(top.chunks_exact(2)).zip(bottom.chunks_exact(2)) {
                let sum = u16::from(t[0]) + u16::from(t[1]) + u16::from(b[0]) + u16::from(b[1]);
                *o = ((sum + 2) >> 2) as u8;
            }
        }
        Self::bordered(width, height, &inner)
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
        assert_eq!(&l1.texels[l1.stride + 1..l1.stride + 3], &[25, 40]);
        assert_eq!(t.levels[2].texels[4], 33);
    }
}
