//! Depth as `compressed_depth_image_transport` packs it besides PNG: columns, rows, and the packing of Wilson, "Fast lossless depth
//! image compression" (ISS 2017, listing 1). Runs without depth alternate with runs of differences, as numbers of a variable count of
//! three-bit groups, eight of them in a word of 32 bits, the first in its highest bits.

use crate::error::DecodeError;
use cairn_sensor::DepthImage;

/// Largest image, pixels; a broken header may state more.
const MAX_PIXELS: usize = 64 << 20;

/// The image of a message's bytes after its header.
///
/// # Errors
/// When the bytes are not one.
pub fn depth(bytes: &[u8]) -> Result<DepthImage, DecodeError> {
    let broken = || DecodeError::new("RVL: the data is not that of an image");
    let [width, height] =
        [0, 4].map(|at| bytes.get(at..)?.first_chunk().map(|b| u32::from_le_bytes(*b) as usize));
    let (width, height) = width.zip(height).ok_or_else(broken)?;
    let count = width.saturating_mul(height);
    if count == 0 || count > MAX_PIXELS {
        return Err(DecodeError::new(format!("RVL: {width}x{height} pixels is not a supported image size")));
    }
    let data = pixels(&bytes[8..], count).ok_or_else(broken)?;
    DepthImage::from_vec(width, height, data).ok_or_else(broken)
}

fn pixels(bytes: &[u8], count: usize) -> Option<Vec<u16>> {
    let mut groups = Groups { bytes, at: 0 };
    let mut data = Vec::new();
    let mut before = 0i32;
    while data.len() < count {
        let (empty, full) = (groups.number()? as usize, groups.number()? as usize);
        if empty + full == 0 || empty + full > count - data.len() {
            return None;
        }
        data.resize(data.len() + empty, 0);
        for _ in 0..full {
            let v = groups.number()?;
            before = before.wrapping_add((v >> 1) as i32 ^ -((v & 1) as i32));
            data.push(u16::try_from(before).ok()?);
        }
    }
    Some(data)
}

/// Three bits each, and one that says whether more of the number follow.
struct Groups<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl Groups<'_> {
    fn number(&mut self) -> Option<u32> {
        let (mut v, mut shift) = (0, 0);
        // Lengths and differences fit 30 bits.
        while shift <= 27 {
            // Words are little-endian: their fourth byte has the first two groups.
            let byte = *self.bytes.get((self.at / 2) ^ 3)?;
            let group = if self.at.is_multiple_of(2) { byte >> 4 } else { byte & 15 };
            self.at += 1;
            v |= u32::from(group & 7) << shift;
            shift += 3;
            if group & 8 == 0 {
                return Some(v);
            }
        }
        None
    }
}
