//! Compressed gray images of key frames, at half the resolution: voxels are larger than their pixels, and twice as many of them
//! would be most of a map. What is fused and removed again is what was packed, so nothing stays behind.

use super::blocks;
use crate::{Backend, DenseError};
use cairn_sensor::GrayImage;
use std::sync::Arc;

/// A compressed gray image; cloning it copies no pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedGray {
    width: usize,
    height: usize,
    bytes: Arc<[u8]>,
}

impl PackedGray {
    /// Compresses an image: of four pixels the mean.
    pub fn pack(image: &GrayImage) -> Self {
        let (width, height) = (image.width(), image.height());
        let mut halves = Vec::with_capacity(width.div_ceil(2) * height.div_ceil(2));
        let data = image.data();
        for y in (0..height).step_by(2) {
            let (above, below) = (&data[y * width..], &data[(y + 1).min(height - 1) * width..]);
            for x in (0..width).step_by(2) {
                let right = (x + 1).min(width - 1);
                let sum: u16 = [above[x], above[right], below[x], below[right]].map(u16::from).iter().sum();
                halves.push((sum + 2) / 4);
            }
        }
        let mut bytes = Vec::new();
        if !halves.is_empty() {
            blocks::pack(&halves, width.div_ceil(2), &mut bytes);
        }
        Self { width, height, bytes: bytes.into() }
    }

    /// Decompresses the image, in its whole size.
    ///
    /// # Errors
    /// Bytes that do not decode to an image.
    pub fn unpack(&self) -> Result<GrayImage, DenseError> {
        let broken = || DenseError::Saved("a packed gray image is broken".into());
        let half = [self.width.div_ceil(2), self.height.div_ceil(2)];
        let mut halves = Vec::new();
        blocks::unpack(Backend::best(), &self.bytes, half[0], half[1], &mut halves).ok_or_else(broken)?;
        if half[0].checked_mul(half[1]) != Some(halves.len()) {
            return Err(broken());
        }
        let mut data = Vec::with_capacity(self.width * self.height);
        let mut row = vec![[0; 2]; half[0]];
        for y in 0..self.height {
            if y % 2 == 0 {
                for (twice, &v) in row.iter_mut().zip(&halves[y / 2 * half[0]..]) {
                    *twice = [v as u8; 2];
                }
            }
            data.extend_from_slice(&row.as_flattened()[..self.width]);
        }
        GrayImage::from_vec(self.width, self.height, data).ok_or_else(broken)
    }

    /// One that was saved as bytes. They are not looked at here: [`Self::unpack`] tells whether they are an image.
    pub fn from_bytes(width: usize, height: usize, bytes: Arc<[u8]>) -> Self {
        Self { width, height, bytes }
    }

    /// The bytes to save.
    pub fn as_bytes(&self) -> &Arc<[u8]> {
        &self.bytes
    }

    /// Width and height of the image in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn unpacked_pixels_are_the_mean_of_their_four(
            width in 1usize..40, height in 1usize..20, seed in proptest::collection::vec(any::<u8>(), 800)
        ) {
            let data: Vec<u8> = seed[..width * height].to_vec();
            let image = GrayImage::from_vec(width, height, data).expect("all pixels");
            let back = PackedGray::pack(&image).unpack().expect("whole");
            prop_assert_eq!((back.width(), back.height()), (width, height));
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let at = |dx: usize, dy: usize| {
                    let (x, y) = ((x / 2 * 2 + dx).min(width - 1), (y / 2 * 2 + dy).min(height - 1));
                    f64::from(image.data()[y * width + x])
                };
                let mean = (at(0, 0) + at(1, 0) + at(0, 1) + at(1, 1)) / 4.0;
                prop_assert!((f64::from(back.data()[y * width + x]) - mean).abs() <= 0.5);
            }
        }

        #[test]
        fn broken_bytes_are_refused_or_some_image(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            if let Ok(image) = PackedGray::from_bytes(16, 8, bytes.into()).unpack() {
                prop_assert_eq!(image.data().len(), 128);
            }
        }
    }

    #[test]
    fn size_of_unpacked_images_is_checked_before_memory_is_taken() {
        assert!(PackedGray::from_bytes(1 << 31, 1 << 31, vec![0, 0, 0, 0, 0, 0].into()).unpack().is_err());
    }
}
