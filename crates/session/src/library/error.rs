//! What goes wrong with a folder of routes, and with the atlas that is kept in it.

use super::MOST_KEY_FRAMES;
use cairn_atlas::store::StoreError;
use cairn_engine::OpenMapError;
use cairn_sensor::RigError;
use std::io;

/// Why a folder of routes cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum LibraryError {
    /// Another program uses it.
    #[error("{0}: another program keeps its routes there")]
    Busy(String),
    /// The folder cannot be written.
    #[error("{path}: {source}")]
    Folder {
        /// The folder.
        path: String,
        /// The system's error.
        source: io::Error,
    },
    /// The rig cannot serve the mode.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// What tracks cannot begin without a map either.
    #[error("{0}")]
    Slam(String),
}

impl From<OpenMapError> for LibraryError {
    fn from(e: OpenMapError) -> Self {
        match e {
            OpenMapError::Rig(e) => e.into(),
            other => Self::Slam(other.to_string()),
        }
    }
}

/// Why the atlas is not on disk as it is.
#[derive(Debug, thiserror::Error)]
pub enum KeepError {
    /// It has become too large to be kept.
    #[error("the map has {0} key frames, at most {MOST_KEY_FRAMES} are kept")]
    TooLarge(usize),
    /// A route of it could not be written.
    #[error("{0}")]
    Route(#[source] io::Error),
    /// Its file could not be written.
    #[error(transparent)]
    Map(#[from] StoreError),
    /// No thread could be begun to write it.
    #[error("{0}")]
    Thread(#[source] io::Error),
    /// The thread that wrote it panicked.
    #[error("saving the map failed by an error of the program")]
    Panicked,
}
