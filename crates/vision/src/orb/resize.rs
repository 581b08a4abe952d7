//! Downsampling an image by a fixed ratio slightly above one, with a triangle filter as wide as the ratio.
//!
//! Destination pixel `i` samples source position `(i + 0.5) * ratio - 0.5`, so positions are preserved whatever the
//! rounding of the sizes. Weights are in units of 1/128; rows are combined first, then columns.

use super::Backend;
use super::resize_scalar::{TAPS, Tap, combine_columns, combine_rows};
use cairn_sensor::GrayImage;

/// Bytes that vector code may read beyond a row of scratch.
const SLACK: usize = 64;

/// A resize plan, independent of the pixel values: taps of both axes and a scratch row.
#[derive(Clone, Debug)]
pub(super) struct Resize {
    source: [usize; 2],
    columns: Vec<Tap>,
    rows: Vec<Tap>,
    scratch: Vec<u8>,
    #[cfg(target_arch = "x86_64")]
    blocks: Option<Vec<super::resize_avx2::Block>>,
    #[cfg(target_feature = "simd128")]
    blocks: Option<Vec<super::resize_simd128::Block>>,
}

impl Resize {
    /// Plans the downsampling of `source` (width, height; both at least 8) by `ratio` (between 1 and 2, exclusive).
    pub(super) fn new(source: [usize; 2], ratio: f64) -> Self {
        let size = source.map(|n| shrunk(n, ratio));
        let columns = taps(source[0], size[0], ratio);
        let rows = taps(source[1], size[1], ratio);
        Self {
            source,
            #[cfg(target_arch = "x86_64")]
            blocks: super::resize_avx2::plan(&columns),
            #[cfg(target_feature = "simd128")]
            blocks: super::resize_simd128::plan(&columns),
            columns,
            rows,
            scratch: vec![0; source[0] + SLACK],
        }
    }

    /// True when this plan is for images of this size.
    pub(super) fn fits(&self, image: &GrayImage) -> bool {
        self.source == [image.width(), image.height()]
    }

    /// Writes the downsampled image to `out`.
    pub(super) fn run(&mut self, source: &GrayImage, out: &mut GrayImage, backend: Backend) {
        out.resize(self.columns.len(), self.rows.len());
        for (y, tap) in self.rows.iter().enumerate() {
            let rows: [&[u8]; TAPS] = std::array::from_fn(|k| source.row(tap.start + k));
            #[cfg(target_arch = "x86_64")]
            if let (true, Some(blocks)) = (backend.has_avx2(), &self.blocks) {
                super::resize_avx2::combine_rows(rows, tap.weights, &mut self.scratch);
                super::resize_avx2::combine_columns(&self.scratch, blocks, &self.columns, out.row_mut(y));
                continue;
            }
            let _ = backend;
            combine_rows(rows, tap.weights, &mut self.scratch, 0);
            #[cfg(target_feature = "simd128")]
            if let Some(blocks) = &self.blocks {
                super::resize_simd128::combine_columns(&self.scratch, blocks, &self.columns, out.row_mut(y));
                continue;
            }
            combine_columns(&self.scratch, &self.columns, out.row_mut(y), 0);
        }
    }
}

/// Length of an axis after downsampling.
pub(super) fn shrunk(n: usize, ratio: f64) -> usize {
    (n as f64 / ratio).floor() as usize
}

fn taps(source: usize, size: usize, ratio: f64) -> Vec<Tap> {
    (0..size).map(|i| tap((i as f64 + 0.5) * ratio - 0.5, source, ratio)).collect()
}

fn tap(centre: f64, source: usize, ratio: f64) -> Tap {
    let first = (centre - ratio).floor() as isize + 1;
    let start = first.clamp(0, (source - TAPS) as isize) as usize;
    let raw: [f64; TAPS] =
        std::array::from_fn(|k| (1.0 - ((start + k) as f64 - centre).abs() / ratio).max(0.0));
    let total: f64 = raw.iter().sum();
    let mut weights = raw.map(|w| ((w / total * 128.0).round() as u8).min(127));
    // The rounding error is added to the largest tap.
    let sum: i32 = weights.iter().map(|&w| w as i32).sum();
    let largest = (0..TAPS).max_by_key(|&k| weights[k]).unwrap_or(0);
    weights[largest] = (weights[largest] as i32 + 128 - sum).clamp(0, 127) as u8;
    Tap { start, weights }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_sum_to_one_and_stay_in_range() {
        for ratio in [1.05, 1.2, 1.41, 1.6] {
            for n in [33usize, 47, 480, 752] {
                for t in taps(n, shrunk(n, ratio), ratio) {
                    assert_eq!(t.weights.iter().map(|&w| w as u32).sum::<u32>(), 128, "{ratio} {n} {t:?}");
                    assert!(t.start + TAPS <= n);
                }
            }
        }
    }

    #[test]
    fn ramp_is_preserved_in_place() {
        let (w, h) = (240, 100);
        let mut image = GrayImage::new(w, h);
        for y in 0..h {
            for x in 0..w {
                image.row_mut(y)[x] = x as u8;
            }
        }
        let mut out = GrayImage::new(0, 0);
        Resize::new([w, h], 1.2).run(&image, &mut out, Backend::Scalar);
        assert_eq!((out.width(), out.height()), (200, 83));
        for x in 4..out.width() - 4 {
            let expected = (x as f64 + 0.5) * 1.2 - 0.5;
            assert!((out.at(x, 40) as f64 - expected).abs() <= 1.0, "{x}");
        }
    }
}
