//! Reads 8-bit gray images in binary PGM format.

use cairn_sensor::GrayImage;

/// Reads a binary PGM (P5, maximum 255) without comments; `None` for anything else.
pub fn read(bytes: &[u8]) -> Option<GrayImage> {
    let mut at = 0;
    let mut word = || {
        let start = at + bytes[at..].iter().position(|b| !b.is_ascii_whitespace())?;
        at = start + bytes[start..].iter().position(|b| b.is_ascii_whitespace())?;
        std::str::from_utf8(&bytes[start..at]).ok()
    };
    if word()? != "P5" {
        return None;
    }
    let (w, h) = (word()?.parse().ok()?, word()?.parse().ok()?);
    if word()? != "255" {
        return None;
    }
    GrayImage::from_vec(w, h, bytes.get(at + 1..)?.to_vec())
}
