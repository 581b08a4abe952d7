//! From picture messages to images: pixels are converted by the readers of bags and image files.

use crate::messages::{CompressedImage, Header, Image};
use cairn::sensor::{DepthImage, GrayImage};
use cairn::sources::{ImageError, decode_depth, decode_gray};
use cairn_bag::DecodeError;

/// Why a picture is none.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The message does not hold what it says.
    #[error(transparent)]
    Message(#[from] DecodeError),
    /// Its image file cannot be read.
    #[error(transparent)]
    File(#[from] ImageError),
}

/// A picture as it came.
#[derive(Clone, Debug)]
pub enum Picture {
    /// Raw pixels.
    Raw(Image),
    /// An image file.
    File(CompressedImage),
}

impl Picture {
    /// Time and frame.
    pub fn header(&self) -> &Header {
        match self {
            Self::Raw(image) => &image.header,
            Self::File(image) => &image.header,
        }
    }

    /// Luminance. `bits` are those in use of pixels of 16, of all pictures until now: it never shrinks, so that they do not flicker.
    ///
    /// # Errors
    /// When the encoding is not read, or the data are not those of an image of the stated size.
    pub fn gray(&self, bits: &mut u32) -> Result<GrayImage, PictureError> {
        match self {
            Self::Raw(image) => {
                let image = raw(image);
                *bits = image.bits().unwrap_or(0).max(*bits);
                Ok(image.gray_of_bits(*bits)?)
            }
            Self::File(image) => Ok(decode_gray(&image.data)?),
        }
    }

    /// Depth in millimetres.
    ///
    /// # Errors
    /// As [`Picture::gray`].
    pub fn depth(&self) -> Result<DepthImage, PictureError> {
        match self {
            Self::Raw(image) => Ok(raw(image).depth()?),
            Self::File(image) => {
                let header = cairn_bag::Header { stamp_ns: 0, frame_id: String::new() };
                let message =
                    cairn_bag::CompressedImage { header, format: image.format.clone(), data: &image.data };
                let mut depth = match message.rvl() {
                    Some(depth) => depth?,
                    None => decode_depth(message.file()?)?,
                };
                message.dequantise(&mut depth);
                Ok(depth)
            }
        }
    }
}

fn raw(image: &Image) -> cairn_bag::ImageMessage<'_> {
    cairn_bag::ImageMessage {
        header: cairn_bag::Header { stamp_ns: 0, frame_id: String::new() },
        height: image.height,
        width: image.width,
        encoding: image.encoding.clone(),
        big_endian: image.is_bigendian != 0,
        step: image.step,
        data: &image.data,
    }
}
