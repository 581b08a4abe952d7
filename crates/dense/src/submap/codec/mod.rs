//! Lossless compression of depth images, in memory and in saved maps.
//!
//! Images are packed in [`blocks`]. The first byte tells that packing from the older one ([`rvl`]), which never begins
//! with a zero byte: its first two numbers, empty and full pixels, are not both zero.

mod block;
mod blocks;
mod gray;
#[cfg(target_arch = "x86_64")]
mod kernel_x86;
mod rvl;

use crate::{Backend, DenseError};
use cairn_sensor::DepthImage;
use std::sync::Arc;

pub(crate) use blocks::Rows;
pub use gray::PackedGray;

/// The first byte of images packed in blocks.
const BLOCKS: u8 = 0;

/// A compressed depth image; cloning it copies no pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedDepth {
    width: usize,
    height: usize,
    bytes: Arc<[u8]>,
}

impl PackedDepth {
    /// Compresses an image.
    pub fn pack(image: &DepthImage) -> Self {
        let mut bytes = vec![BLOCKS];
        blocks::pack(image.data(), image.width(), &mut bytes);
        Self { width: image.width(), height: image.height(), bytes: bytes.into() }
    }

    /// Decompresses the image.
    ///
    /// # Errors
    /// Bytes that do not decode to an image.
    pub fn unpack(&self) -> Result<DepthImage, DenseError> {
        self.unpack_with(Backend::best())
    }

    fn unpack_with(&self, backend: Backend) -> Result<DepthImage, DenseError> {
        let mut data = Vec::new();
        self.unpack_to(backend, &mut data)?;
        DepthImage::from_vec(self.width, self.height, data).ok_or_else(broken)
    }

    /// Puts the pixels in place of what is in `data`: from image to image its memory is used again.
    pub(crate) fn unpack_to(&self, backend: Backend, data: &mut Vec<u16>) -> Result<(), DenseError> {
        let count = self.width.checked_mul(self.height).ok_or_else(broken)?;
        match self.bytes.split_first() {
            Some((&BLOCKS, packed)) => blocks::unpack(backend, packed, self.width, self.height, data),
            _ => rvl::unpack(&self.bytes, count).map(|all| *data = all),
        }
        .filter(|()| data.len() == count)
        .ok_or_else(broken)
    }

    /// The rows of an image packed in blocks; `None` for one in the older packing.
    ///
    /// # Errors
    /// Bytes that are not an image.
    pub(crate) fn rows(&self) -> Result<Option<Rows<'_>>, DenseError> {
        match self.bytes.split_first() {
            Some((&BLOCKS, packed)) => {
                Rows::new(packed, self.width, self.height).map(Some).ok_or_else(broken)
            }
            _ => Ok(None),
        }
    }

    /// One that was saved as bytes. They are not looked at here: [`Self::unpack`] tells whether they are an image.
    pub fn from_bytes(width: usize, height: usize, bytes: Arc<[u8]>) -> Self {
        Self { width, height, bytes }
    }

    /// Width and height of the image in pixels.
    pub fn size(&self) -> [usize; 2] {
        [self.width, self.height]
    }

    /// The bytes to save.
    pub fn as_bytes(&self) -> &Arc<[u8]> {
        &self.bytes
    }

    /// Size in bytes.
    pub fn bytes(&self) -> usize {
        self.bytes.len()
    }
}

/// What is said of bytes that are not an image.
pub(crate) fn broken() -> DenseError {
    DenseError::Saved("a packed depth image is broken".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pixel() -> impl Strategy<Value = u16> {
        prop_oneof![4 => Just(0u16), 1 => Just(u16::MAX), 8 => 500u16..520, 1 => any::<u16>()]
    }

    fn image() -> impl Strategy<Value = DepthImage> {
        (1usize..40, 1usize..20).prop_flat_map(|(width, height)| {
            let data = proptest::collection::vec(pixel(), width * height);
            data.prop_map(move |data| DepthImage::from_vec(width, height, data).expect("all pixels"))
        })
    }

    proptest! {
        #[test]
        fn every_image_comes_back_with_every_backend(image in image()) {
            let packed = PackedDepth::pack(&image);
            for backend in Backend::ALL.into_iter().filter(|b| b.available()) {
                prop_assert_eq!(packed.unpack_with(backend).expect("whole"), image.clone());
            }
        }

        #[test]
        fn images_of_older_maps_come_back(image in image()) {
            let bytes = rvl::tests::pack(image.data());
            prop_assert!(bytes[0] != BLOCKS);
            let packed = PackedDepth::from_bytes(image.width(), image.height(), bytes.into());
            prop_assert_eq!(packed.unpack().expect("whole"), image);
        }

        #[test]
        fn broken_bytes_are_refused_or_some_image(
            first in 0u8..3, bytes in proptest::collection::vec(any::<u8>(), 0..200)
        ) {
            let bytes = std::iter::once(first).chain(bytes).collect();
            if let Ok(image) = PackedDepth::from_bytes(16, 8, bytes).unpack() {
                prop_assert_eq!(image.data().len(), 128);
            }
        }

        #[test]
        fn a_flipped_or_missing_byte_never_panics(image in image(), at: prop::sample::Index, flip: u8) {
            let mut bytes = PackedDepth::pack(&image).bytes.to_vec();
            let at = at.index(bytes.len());
            let cut = bytes[..at].to_vec();
            let cut = PackedDepth::from_bytes(image.width(), image.height(), cut.into());
            prop_assert!(cut.unpack().is_err(), "cut at {}", at);
            bytes[at] ^= flip;
            let _ = PackedDepth::from_bytes(image.width(), image.height(), bytes.into()).unpack();
        }
    }

    #[test]
    fn images_of_one_value_and_of_all_values_come_back() {
        for data in
            [vec![0; 512 * 128], vec![u16::MAX; 512 * 128], vec![7; 512 * 128], (0..=u16::MAX).collect()]
        {
            let image = DepthImage::from_vec(512, 128, data).expect("all pixels");
            assert_eq!(PackedDepth::pack(&image).unpack().expect("whole"), image);
        }
    }

    #[test]
    fn size_of_unpacked_images_is_checked_before_memory_is_taken() {
        let packed = PackedDepth::from_bytes(1 << 31, 1 << 31, vec![BLOCKS, 0, 0, 0, 0, 0, 0].into());
        assert!(packed.unpack().is_err());
    }
}
