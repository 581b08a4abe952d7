//! A texture as a chain of halved images, each with a border of one texel so that bilinear reads need no test, in tiles of a line
//! of the processor's cache, so that what is near in the image is near in memory whichever way the texture is turned.
//!
//! Level 0 texel `i` covers `i..i+1` texel units; level `l` texel `i` covers `i * 2^l .. (i + 1) * 2^l`, so a
//! point keeps its place at every level and only its sharpness changes.

/// Texels from tile to tile. A tile has one more row and column, which are also the first of the next.
pub(crate) const TILE: usize = 7;

/// Eight rows of eight texels.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Tile(pub [u8; 64]);

/// One level, border included.
#[derive(Clone, Debug)]
pub(crate) struct Level {
    /// Width and height without border, in 1/256 texel.
    pub limits: [f32; 2],
    /// Tiles in a row of tiles.
    pub stride: usize,
    /// The tiles: all that a bilinear read needs which begins at a column up to the width and a row up to the height is in one.
    pub tiles: Vec<Tile>,
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
        let mut levels = vec![Level::new(width, height, texels, 256.0)];
        let (mut inner, mut size) = (texels.to_vec(), (width, height));
        while size != (1, 1) {
            inner = half(size, &inner);
            size = (size.0.div_ceil(2), size.1.div_ceil(2));
            levels.push(Level::new(size.0, size.1, &inner, 256.0 / (1u32 << levels.len()) as f32));
        }
        Self { levels }
    }
}

/// Averages 2x2 blocks; an odd last row or column counts twice.
fn half((width, height): (usize, usize), texels: &[u8]) -> Vec<u8> {
    let mut out = Vec::with_capacity(width.div_ceil(2) * height.div_ceil(2));
    for y in (0..height).step_by(2) {
        let row = |y: usize| &texels[y.min(height - 1) * width..][..width];
        let mean = |t: &[u8], b: &[u8]| {
            let sum = [t[0], t[t.len() - 1], b[0], b[b.len() - 1]].iter().map(|v| u16::from(*v)).sum::<u16>();
            ((sum + 2) >> 2) as u8
        };
        out.extend(row(y).chunks(2).zip(row(y + 1).chunks(2)).map(|(t, b)| mean(t, b)));
    }
    out
}

impl Level {
    fn new(width: usize, height: usize, inner: &[u8], scale: f32) -> Self {
        assert!(width.max(height) <= MAX_SIDE, "a texture of {width}x{height}");
        let stride = width / TILE + 1;
        let mut tiles = vec![Tile([0; 64]); stride * (height / TILE + 1)];
        let mut row = vec![0; stride * TILE + 1];
        for y in 0..height / TILE * TILE + 8 {
            let source = &inner[(y.clamp(1, height) - 1) * width..][..width];
            row[0] = source[0];
            row[1..=width].copy_from_slice(source);
            row[width + 1..].fill(source[width - 1]);
            let mut put = |tiles_row: usize, line: usize| {
                for (i, tile) in tiles[tiles_row * stride..][..stride].iter_mut().enumerate() {
                    tile.0[8 * line..][..8].copy_from_slice(&row[i * TILE..][..8]);
                }
            };
            if y / TILE <= height / TILE {
                put(y / TILE, y % TILE);
            }
            if y > 0 && y % TILE == 0 {
                put(y / TILE - 1, TILE);
            }
        }
        Self { limits: [width, height].map(|n| (256 * n) as f32), stride, tiles, scale }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The texel at a column and row, counted with the border.
    fn texel(level: &Level, x: usize, y: usize) -> u8 {
        level.tiles[y / TILE * level.stride + x / TILE].0[y % TILE * 8 + x % TILE]
    }

    #[test]
    fn halving_keeps_mean_and_odd_edge() {
        let t = Texture::new(3, 2, &[10, 20, 30, 30, 40, 50]);
        assert_eq!(t.levels.len(), 3);
        let l1 = &t.levels[1];
        assert_eq!(l1.limits, [512.0, 256.0]);
        assert_eq!([texel(l1, 1, 1), texel(l1, 2, 1)], [25, 40]);
        assert_eq!(texel(&t.levels[2], 0, 0), 33);
    }

    #[test]
    fn tiles_hold_each_texel_its_neighbours_and_the_border() {
        let (width, height) = (23, 14);
        let texels: Vec<u8> = (0..width * height).map(|i| (i * 7 % 251) as u8).collect();
        let level = &Texture::new(width, height, &texels).levels[0];
        for (x, y) in (0..=height).flat_map(|y| (0..=width).map(move |x| (x, y))) {
            let tile = &level.tiles[y / TILE * level.stride + x / TILE].0;
            for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
                let at = (y + dy).clamp(1, height) * width - width + (x + dx).clamp(1, width) - 1;
                assert_eq!(tile[(y % TILE + dy) * 8 + x % TILE + dx], texels[at], "{x}+{dx}, {y}+{dy}");
            }
        }
    }
}
