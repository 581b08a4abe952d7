//! Why a map file could not be written or read, in words that name the file, the part and the cure.

use std::io;
use std::path::{Path, PathBuf};

/// Why a map could not be saved or opened.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// The system refused.
    #[error("{}: {doing}: {source}", path.display())]
    File {
        /// Which file or folder.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// What the system said.
        source: io::Error,
    },
    /// The bytes are no map of ours.
    #[error("not a map file: {0}")]
    Foreign(String),
    /// A later program wrote it.
    #[error("the map has format version {found}, this program reads versions 1 to {known}")]
    Version {
        /// Version of the file.
        found: u32,
        /// Latest version that this program knows.
        known: u32,
    },
    /// A part is cut off, altered, or does not say what it should.
    #[error("part '{part}': {why}")]
    Part {
        /// Name of the part; "header" and "table" for what stands before the parts.
        part: String,
        /// What is wrong.
        why: String,
    },
    /// What is to be written can not be.
    #[error("the map can not be saved: {0}")]
    Unfit(String),
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
