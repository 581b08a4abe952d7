//! The scale pyramid of one image.

use super::resize::{Resize, shrunk};
use super::{BORDER, Backend};
use cairn_sensor::GrayImage;

/// An image and its smaller copies; one pixel of level `l` is `factor^l` pixels of the image wide.
///
/// Pixel centres are at integer coordinates on every level: position `x` on level `l` is `(x + 0.5) * factor^l - 0.5`
/// in the image.
#[derive(Clone, Debug)]
pub struct Pyramid {
    factor: f64,
    levels: Vec<GrayImage>,
    used: usize,
    plans: Vec<Resize>,
}

impl Pyramid {
    /// An empty pyramid of at most `levels` levels (at least one) with a ratio of `factor` (clamped to 1.05 to 1.6).
    pub fn new(levels: usize, factor: f64) -> Self {
        let factor = if factor.is_finite() { factor.clamp(1.05, 1.6) } else { 1.2 };
        let levels = vec![GrayImage::new(0, 0); levels.max(1)];
        Self { factor, levels, used: 0, plans: Vec::new() }
    }

    /// Fills the levels from an image. Levels too small for a feature are omitted, but never level 0.
    pub fn build(&mut self, image: &GrayImage, backend: Backend) {
        self.build_with(image, backend, |_| {});
    }

    /// The same; hands out each level as soon as it is made, finest first.
    pub(super) fn build_with<'a>(
        &'a mut self,
        image: &GrayImage,
        backend: Backend,
        mut made: impl FnMut(&'a GrayImage),
    ) {
        let Self { factor, levels, used, plans } = self;
        let Some((first, mut rest)) = levels.split_first_mut() else { return };
        first.resize(image.width(), image.height());
        first.data_mut().copy_from_slice(image.data());
        let mut source: &GrayImage = first;
        made(source);
        *used = 1;
        while let Some((next, others)) = rest.split_first_mut() {
            let least = shrunk(source.width().min(source.height()), *factor);
            if least <= 2 * BORDER {
                break;
            }
            let at = *used - 1;
            if plans.get(at).is_none_or(|p| !p.fits(source)) {
                plans.truncate(at);
                plans.push(Resize::new([source.width(), source.height()], *factor));
            }
            plans[at].run(source, next, backend);
            (source, rest) = (next, others);
            made(source);
            *used += 1;
        }
    }

    /// The levels of the last image, finest first.
    pub fn levels(&self) -> &[GrayImage] {
        &self.levels[..self.used]
    }

    /// Ratio between neighbouring levels.
    pub fn factor(&self) -> f64 {
        self.factor
    }

    /// Size of one pixel of `level` in pixels of the image.
    pub fn scale(&self, level: usize) -> f64 {
        self.factor.powi(level as i32)
    }

    /// Converts a position on `level` to a position in the image.
    pub fn to_image(&self, level: usize, at: [f32; 2]) -> [f32; 2] {
        let scale = self.scale(level);
        at.map(|c| ((c as f64 + 0.5) * scale - 0.5) as f32)
    }

    /// Converts a position in the image to a position on `level`.
    pub fn to_level(&self, level: usize, at: [f32; 2]) -> [f32; 2] {
        let scale = self.scale(level);
        at.map(|c| ((c as f64 + 0.5) / scale - 0.5) as f32)
    }
}
