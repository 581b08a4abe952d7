//! How a camera was turned when it took a JPEG (EXIF 2.32, tag 0x0112), and the picture turned upright.
//!
//! Pictures are taken as they are stored, which is as the sensor sees, however the camera is held. OpenCV turns them when it
//! reads them, so that a calibration may be of turned pictures.

use cairn_sensor::GrayImage;

/// The orientation that a JPEG states, 2 to 8; `None` for upright pictures, and where none is stated.
pub fn orientation(jpeg: &[u8]) -> Option<u16> {
    let mut at = 2;
    loop {
        let &[0xff, kind, high, low] = jpeg.get(at..at + 4)? else { return None };
        let length = usize::from(u16::from_be_bytes([high, low]));
        let body = jpeg.get(at + 4..at + 2 + length)?;
        match body.strip_prefix(b"Exif\0\0") {
            Some(tiff) if kind == 0xe1 => return of_tiff(tiff),
            // The picture itself begins.
            _ if kind == 0xda => return None,
            _ => at += 2 + length,
        }
    }
}

fn of_tiff(tiff: &[u8]) -> Option<u16> {
    let is_big = tiff.starts_with(b"MM");
    let two = |at: usize| {
        let bytes = [*tiff.get(at)?, *tiff.get(at.checked_add(1)?)?];
        Some(if is_big { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) })
    };
    let [first, second] = [two(4)?, two(6)?].map(usize::from);
    let directory = if is_big { first << 16 | second } else { second << 16 | first };
    let entries = (0..usize::from(two(directory)?)).map(|i| directory + 2 + 12 * i);
    let value = entries
        .take_while(|at| *at < tiff.len())
        .find(|at| two(*at) == Some(0x0112))
        .map(|at| two(at + 8))?;
    value.filter(|value| (2..=8).contains(value))
}

/// A picture of orientation 6 or 8, turned by a quarter; `None` for the others.
pub fn upright(image: &GrayImage, orientation: u16) -> Option<GrayImage> {
    let (width, height) = (image.width(), image.height());
    let from = |x: usize, y: usize| match orientation {
        6 => Some((y, height - 1 - x)),
        8 => Some((width - 1 - y, x)),
        _ => None,
    };
    let mut out = GrayImage::new(height, width);
    for y in 0..width {
        for x in 0..height {
            let (a, b) = from(x, y)?;
            out.row_mut(y)[x] = image.row(b)[a];
        }
    }
    Some(out)
}
