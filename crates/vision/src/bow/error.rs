//! Why bytes are not a vocabulary.

use std::fmt;

/// The version of the file format that is read and written.
pub(super) const VERSION: u32 = 1;

/// Why bytes are not a valid vocabulary.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum VocabularyError {
    /// Does not begin with the magic bytes of a vocabulary.
    NotAVocabulary,
    /// Unsupported format version.
    Version(u32),
    /// The length does not match the header.
    Length {
        /// Actual length in bytes.
        found: usize,
        /// Length in bytes that follows from the header.
        expected: usize,
    },
    /// The checksum does not match: the file was altered.
    Checksum,
    /// The checksum matches, but the content is inconsistent.
    Content(&'static str),
}

impl fmt::Display for VocabularyError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotAVocabulary => write!(f, "not a vocabulary file (it does not begin with CAIRNVOC)"),
            Self::Version(v) => {
                write!(f, "the vocabulary has format version {v}, only version {VERSION} is supported")
            }
            Self::Length { found, expected } => {
                write!(
                    f,
                    "the vocabulary has {found} bytes, its header requires {expected}: it is cut off or damaged"
                )
            }
            Self::Checksum => write!(f, "the vocabulary is damaged (its checksum does not match)"),
            Self::Content(what) => write!(f, "the vocabulary is inconsistent: {what}"),
        }
    }
}

impl std::error::Error for VocabularyError {}
