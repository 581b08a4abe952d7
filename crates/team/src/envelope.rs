//! The header of every message: `version` (1 byte), `kind` (1), CRC-32 of the rest (4, little endian), then the body.

use crate::ids::RobotId;

/// The version that this program reads and writes.
pub const VERSION: u8 = 3;

/// Why a message was refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Refused {
    /// It is longer than the limit ([`crate::MAX_BYTES`], for words [`crate::MAX_WORDS_BYTES`]).
    #[error("the message has {0} bytes, more than are read")]
    TooLong(usize),
    /// It is shorter than its header.
    #[error("the message ends after {0} bytes")]
    TooShort(usize),
    /// It has another version.
    #[error("the message has version {0}, this program reads version {VERSION}")]
    Version(u8),
    /// It is of another kind than expected, or of an unknown one.
    #[error("the message is of kind {0}, another one was expected here")]
    Kind(u8),
    /// The checksum does not match the bytes.
    #[error("the checksum of the message does not fit its bytes")]
    Checksum,
    /// The bytes are not a valid message, or there are extra bytes after it.
    #[error("the message cannot be decoded")]
    Encoding,
    /// The sender named in the message is not the robot that it came from.
    #[error("robot {from} sent a message as robot {claimed}")]
    WrongSender {
        /// The robot that it came from.
        from: RobotId,
        /// The sender named in the message.
        claimed: RobotId,
    },
    /// The sender named in the message is the robot that received it.
    #[error("a message claims to be from this robot")]
    OwnId,
    /// A message with this number or a higher one was received before: this one is late, a duplicate, or replayed.
    #[error("message {number} of robot {robot} came after number {newest}")]
    Old {
        /// The sender.
        robot: RobotId,
        /// Its number.
        number: u32,
        /// The highest number received before.
        newest: u32,
    },
    /// Its poses have another dimension.
    #[error("the message is about poses of {found} dimensions, not {expected}")]
    Dimension {
        /// Dimension of the message.
        found: u8,
        /// Dimension of this team.
        expected: u8,
    },
    /// Its parts contradict each other.
    #[error("the message contradicts itself: {0}")]
    Inconsistent(&'static str),
    /// There are more robots than [`crate::MAX_ROBOTS`].
    #[error("there are too many robots to listen to one more")]
    TooManyRobots,
    /// It is not encrypted with the key of this team, or was changed on its way.
    #[error("the message is not encrypted with the key of this team")]
    Seal,
    /// Its signature is not of the key that it names.
    #[error("a map of robot {0} has a wrong signature")]
    Signature(RobotId),
    /// It is signed with another key than the first from this robot: another robot uses its number.
    #[error("a map of robot {0} is signed with another key than the first one: two robots use this number")]
    OtherKey(RobotId),
    /// More would have to be held than this many bytes.
    #[error("the maps of the team have more than {0} bytes")]
    TooMuch(usize),
}

const HEADER: usize = 6;

/// Kind of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The graph of a robot.
    Graph = 1,
    /// The visual words of a keyframe.
    Words = 2,
    /// Where the key frames of a map stand.
    Viewpoints = 3,
    /// Which key frames a robot asks for.
    Requests = 4,
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
