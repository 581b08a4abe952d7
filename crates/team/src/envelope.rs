//! The header of every message: `version` (1 byte), `kind` (1), CRC-32 of the rest (4, little endian), then the body.

use crate::message::{Refused, VERSION};

const HEADER: usize = 6;

/// Kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The graph of a robot.
    Graph = 1,
    /// The visual words of a keyframe.
    Words = 2,
}

/// The bytes of a message with this body.
pub fn seal(kind: Kind, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(HEADER + body.len());
    bytes.extend([VERSION, kind as u8]);
    bytes.extend(crc32fast::hash(body).to_le_bytes());
    bytes.extend(body);
    bytes
}

/// The body of a message of this kind.
pub fn open(kind: Kind, bytes: &[u8]) -> Result<&[u8], Refused> {
    let short = || Refused::TooShort(bytes.len());
    let (version, rest) = bytes.split_first().ok_or_else(short)?;
    if *version != VERSION {
        return Err(Refused::Version(*version));
    }
    let (found, rest) = rest.split_first().ok_or_else(short)?;
    let (checksum, body) = rest.split_first_chunk::<4>().ok_or_else(short)?;
    if *found != kind as u8 {
        return Err(Refused::Kind(*found));
    }
    if crc32fast::hash(body) != u32::from_le_bytes(*checksum) {
        return Err(Refused::Checksum);
    }
    Ok(body)
}
