//! Gaussian blur of 7 x 7 pixels, sigma 2, applied before the descriptor's comparisons.

use super::{Backend, blur_scalar};
use cairn_sensor::GrayImage;

/// Replicated pixels on each side of the scratch row.
pub(super) const MARGIN: usize = 3;
/// Bytes that vector code may read or write beyond a row of scratch.
const SLACK: usize = 64;

/// A blurred image with readable padding after its last pixel; reused from level to level.
#[derive(Clone, Debug, Default)]
pub(super) struct Blurred {
    /// Contiguous rows, then padding.
    data: Vec<u8>,
    width: usize,
    scratch: Vec<u8>,
}

impl Blurred {
    /// Blurs `image` (edges replicated) and keeps the result.
    pub(super) fn run(&mut self, image: &GrayImage, backend: Backend) {
        let (w, h) = (image.width(), image.height());
        self.width = w;
        let needed = w * h + SLACK;
        if self.data.len() < needed {
            self.data.resize(needed, 0);
        }
        self.scratch.clear();
        self.scratch.resize(w + 2 * MARGIN + SLACK, 0);
        for y in 0..h {
            let rows: [&[u8]; 7] =
                std::array::from_fn(|k| image.row((y + k).saturating_sub(MARGIN).min(h - 1)));
            let out = &mut self.data[y * w..];
            #[cfg(target_arch = "x86_64")]
            if backend.has_avx2() {
                let wide = backend == Backend::Avx512;
                let columns = if wide { super::blur_avx512::columns } else { super::blur_avx2::columns };
                let row = if wide { super::blur_avx512::row } else { super::blur_avx2::row };
                columns(rows, &mut self.scratch[MARGIN..]);
                replicate(&mut self.scratch, w);
                row(&self.scratch, &mut out[..w + SLACK], w);
                continue;
            }
            let _ = backend;
            blur_scalar::columns(rows, &mut self.scratch[MARGIN..], 0);
            replicate(&mut self.scratch, w);
            blur_scalar::row(&self.scratch, &mut out[..w]);
        }
    }

    /// All pixels row by row, followed by at least four more bytes.
    pub(super) fn data(&self) -> &[u8] {
        &self.data
    }

    /// Pixels from one row to the next.
    pub(super) fn stride(&self) -> usize {
        self.width
    }
}

fn replicate(scratch: &mut [u8], w: usize) {
    let (first, last) = (scratch[MARGIN], scratch[MARGIN + w - 1]);
    scratch[..MARGIN].fill(first);
    scratch[MARGIN + w..MARGIN + w + MARGIN].fill(last);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn constant_image_is_unchanged() {
        let image = GrayImage::from_vec(41, 37, vec![255; 41 * 37]).unwrap();
        let mut b = Blurred::default();
        b.run(&image, Backend::detect());
        assert!(b.data()[..41 * 37].iter().all(|&v| v == 255));
    }
}
