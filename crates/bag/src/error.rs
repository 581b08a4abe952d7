//! Errors that concern a whole bag, and the position of damage.

use std::fmt;

use std::io;

/// Why a bag could not be opened or a message could not be read.
#[derive(Debug, thiserror::Error)]
pub enum BagError {
    /// The operating system could not read the file.
    #[error("{path}: cannot be read ({source})")]
    Io {
        /// The file.
        path: String,
        /// The error of the system.
        source: io::Error,
    },
    /// The file has another format, or a version that is not supported.
    #[error("{path}: {why}")]
    Unsupported {
        /// The file.
        path: String,
        /// What it is.
        why: String,
        /// What the user can do.
        cure: String,
    },
    /// The bytes at this position are not what the format requires.
    #[error("{path}: damaged at byte {at}: {why}")]
    Damaged {
        /// The file.
        path: String,
        /// Offset in the file.
        at: u64,
        /// What is wrong there.
        why: String,
    },
}

impl BagError {
    /// What the user can do about it.
    pub fn cure(&self) -> &str {
        match self {
            Self::Io { .. } => "check the path and its permissions",
            Self::Unsupported { cure, .. } => cure,
            Self::Damaged { .. } => "copy or record the file again",
        }
    }
}

/// The position from which a file is invalid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Damage {
    /// Offset of the damage.
    pub at: u64,
    /// What is wrong there.
    pub why: String,
}

impl Damage {
    pub fn new(at: u64, why: impl Into<String>) -> Self {
        Self { at, why: why.into() }
    }
}

/// Why a message cannot be decoded.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct DecodeError(pub String);

impl DecodeError {
    /// An error with this text.
    pub fn new(why: impl fmt::Display) -> Self {
        Self(why.to_string())
    }
}
