//! The images of a packet as the bytes of a slot, and back.
//!
//! ```text
//! images u32 | for each: width u32, height u32 | depth width u32, height u32 (0 0: none)
//! pixels of the images, then of the depth image (u16), rows end to end
//! ```

use cairn_sensor::{DepthImage, FramePacket, GrayImage, Image, Rig};
use std::sync::Arc;

/// Bytes that the frames of a rig take at most.
pub fn slot_bytes(rig: &Rig) -> u64 {
    let area = |c: &cairn_sensor::Camera| (c.width * c.height) as u64;
    let gray: u64 = rig.cameras.iter().map(|c| area(&c.camera)).sum();
    let depth = rig.depth.as_ref().map_or(0, |d| 2 * area(&d.camera));
    4 + 8 * (rig.cameras.len() as u64 + 1) + gray + depth
}

/// Hands the pieces of a packet's bytes to `write`; only depth is copied.
pub fn pieces<R>(packet: &FramePacket, write: impl FnOnce(&[&[u8]]) -> R) -> R {
    let mut head = Vec::with_capacity(4 + 8 * (packet.images.len() + 1));
    let mut put = |n: usize| head.extend((n as u32).to_le_bytes());
    put(packet.images.len());
    packet.images.iter().for_each(|image| [image.width(), image.height()].into_iter().for_each(&mut put));
    let size = packet.depth.as_ref().map_or([0, 0], |d| [d.width(), d.height()]);
    size.into_iter().for_each(&mut put);
    let depth: Vec<u8> =
        packet.depth.iter().flat_map(|d| d.data().iter().flat_map(|v| v.to_le_bytes())).collect();
    let mut pieces: Vec<&[u8]> = vec![&head];
    pieces.extend(packet.images.iter().map(|image| image.data()));
    pieces.push(&depth);
    write(&pieces)
}

/// The images of a packet, and its depth image.
pub type Images = (Vec<Arc<GrayImage>>, Option<Arc<DepthImage>>);

/// The images in the bytes of a slot; `None` when they are not those of a packet.
pub fn read(bytes: &[u8]) -> Option<Images> {
    let mut rest = bytes;
    let count = next_u32(&mut rest)?;
    // Each image takes at least the eight bytes of its size.
    if count > rest.len() / 8 {
        return None;
    }
    let mut sizes = Vec::with_capacity(count + 1);
    for _ in 0..=count {
        sizes.push((next_u32(&mut rest)?, next_u32(&mut rest)?));
    }
    let (width, height) = sizes.pop()?;
    let mut images = Vec::with_capacity(count);
    for (width, height) in sizes {
        let (here, after) = rest.split_at_checked(width.checked_mul(height)?)?;
        images.push(Arc::new(Image::from_vec(width, height, here.to_vec())?));
        rest = after;
    }
    let (values, odd) = rest.as_chunks::<2>();
    if !odd.is_empty() || values.len() != width.checked_mul(height)? {
        return None;
    }
    let depth = values.iter().map(|v| u16::from_le_bytes(*v)).collect();
    let depth = (width > 0).then(|| Image::from_vec(width, height, depth)).flatten();
    Some((images, depth.map(Arc::new)))
}

fn next_u32(rest: &mut &[u8]) -> Option<usize> {
    let (here, after) = rest.split_first_chunk::<4>()?;
    *rest = after;
    Some(u32::from_le_bytes(*here) as usize)
}
