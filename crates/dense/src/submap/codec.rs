//! Lossless compression of depth images in memory.
//!
//! Wilson, "Fast lossless depth image compression" (ISS 2017): runs without depth alternate with runs of differences,
//! as numbers of a variable count of three-bit groups. A kitchen image of 614 kB takes about 170 kB.

use crate::DenseError;
use cairn_sensor::DepthImage;
use std::sync::Arc;

/// A compressed depth image; cloning it copies no pixels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PackedDepth {
    width: usize,
    height: usize,
    /// Each byte holds two groups of three bits, each with a flag whether more follow.
    bytes: Arc<[u8]>,
}

#[derive(Default)]
struct Writer {
    bytes: Vec<u8>,
    half: Option<u8>,
}

impl Writer {
    fn number(&mut self, mut v: u32) {
        loop {
            let group = (v & 7) as u8 | if v > 7 { 8 } else { 0 };
            match self.half.take() {
                None => self.half = Some(group),
                Some(low) => self.bytes.push(low | group << 4),
            }
            v >>= 3;
            if v == 0 {
                return;
            }
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Reader<'_> {
    fn number(&mut self) -> Option<u32> {
        let (mut v, mut shift) = (0u32, 0);
        loop {
            let byte = *self.bytes.get(self.at / 2)?;
            let group = if self.at.is_multiple_of(2) { byte & 15 } else { byte >> 4 };
            self.at += 1;
            // Lengths and differences fit 30 bits.
            if shift > 27 {
                return None;
            }
            v |= u32::from(group & 7) << shift;
            shift += 3;
            if group & 8 == 0 {
                return Some(v);
            }
        }
    }
}

impl PackedDepth {
    /// Compresses an image.
    pub fn pack(image: &DepthImage) -> Self {
        let data = image.data();
        let mut out = Writer::default();
        let (mut at, mut before) = (0, 0i32);
        while at < data.len() {
            let empty = data[at..].iter().take_while(|&&v| v == 0).count();
            out.number(empty as u32);
            at += empty;
            let full = data[at..].iter().take_while(|&&v| v != 0).count();
            out.number(full as u32);
            for &v in &data[at..at + full] {
                let step = i32::from(v) - before;
                out.number(((step << 1) ^ (step >> 31)) as u32);
                before = i32::from(v);
            }
            at += full;
        }
        if let Some(low) = out.half.take() {
            out.bytes.push(low);
        }
        Self { width: image.width(), height: image.height(), bytes: out.bytes.into() }
    }

    /// Decompresses the image.
    ///
    /// # Errors
    /// Bytes that do not decode to an image.
    pub fn unpack(&self) -> Result<DepthImage, DenseError> {
        let broken = || DenseError::Saved("a packed depth image is broken".into());
        let count = self.width.checked_mul(self.height).ok_or_else(broken)?;
        let mut data = Vec::with_capacity(count.min(1 << 26));
        let mut from = Reader { bytes: &self.bytes, at: 0 };
        let mut before = 0i32;
        while data.len() < count {
            let empty = from.number().ok_or_else(broken)? as usize;
            let full = from.number().ok_or_else(broken)? as usize;
            if empty + full == 0 || empty + full > count - data.len() {
                return Err(broken());
            }
            data.resize(data.len() + empty, 0);
            for _ in 0..full {
                let v = from.number().ok_or_else(broken)?;
                before = before.wrapping_add((v >> 1) as i32 ^ -((v & 1) as i32));
                data.push(u16::try_from(before).map_err(|_| broken())?);
            }
        }
        DepthImage::from_vec(self.width, self.height, data).ok_or_else(broken)
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

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn every_image_comes_back(
            data in proptest::collection::vec(prop_oneof![Just(0u16), 500u16..520, any::<u16>()], 24 * 17)
        ) {
            let image = DepthImage::from_vec(24, 17, data).expect("all pixels");
            prop_assert_eq!(PackedDepth::pack(&image).unpack().expect("whole"), image);
        }

        #[test]
        fn broken_bytes_are_refused_or_some_image(bytes in proptest::collection::vec(any::<u8>(), 0..80)) {
            let packed = PackedDepth { width: 16, height: 8, bytes: bytes.into() };
            if let Ok(image) = packed.unpack() {
                prop_assert_eq!(image.data().len(), 128);
            }
        }
    }
}
