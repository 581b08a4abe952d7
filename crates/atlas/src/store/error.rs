//! Errors of writing and reading map files; messages name the file, the part and the reason.

use std::io;
use std::path::{Path, PathBuf};

/// Why a map could not be saved or loaded.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// A file operation failed.
    #[error("{}: {doing}: {source}", path.display())]
    File {
        /// Which file or folder.
        path: PathBuf,
        /// The operation.
        doing: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// The bytes are not a Cairn map.
    #[error("not a map file: {0}")]
    Foreign(String),
    /// A newer program wrote it.
    #[error("the map has format version {found}, this program reads versions 1 to {known}")]
    Version {
        /// Version of the file.
        found: u32,
        /// Latest version that this program knows.
        known: u32,
    },
    /// Its features were described in another way.
    #[error(
        "the features of the map have descriptors of kind {found:08x}, this program computes kind {known:08x}: no place in it \
         could be recognised; map it again, or open it with the program that made it"
    )]
    Descriptors {
        /// Kind of descriptor in the file.
        found: u32,
        /// The kind that this program computes.
        known: u32,
    },
    /// A part is truncated, damaged or invalid.
    #[error("part '{part}': {why}")]
    Part {
        /// Name of the part; "header" and "table" for what comes before the parts.
        part: String,
        /// What is wrong.
        why: String,
    },
    /// The map cannot be written.
    #[error("the map cannot be saved: {0}")]
    CombineError(String),
}

impl StoreError {
    pub(crate) fn part(part: &str, why: impl Into<String>) -> Self {
        Self::Part { part: part.to_owned(), why: why.into() }
    }

    pub(crate) fn file(path: &Path, doing: &'static str) -> impl FnOnce(io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::File { path, doing, source }
    }
}
