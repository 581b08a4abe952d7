//! Why the program gives up a recording.

use cairn_rerun::WireError;
use re_sdk::RecordingStreamError;
use re_sdk::sink::SinkFlushError;
use std::io;

/// Why a recording was not begun, or is not complete.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// The messages cannot be read.
    #[error(transparent)]
    Messages(#[from] WireError),
    /// Something comes before [`cairn_rerun::Message::Begin`], or nothing comes.
    #[error("the first message is not the beginning of a recording")]
    NoBeginning,
    /// A second [`cairn_rerun::Message::Begin`].
    #[error("the recording begins twice")]
    BeginsTwice,
    /// The pipe was closed before [`cairn_rerun::Message::End`].
    #[error("the messages end before the run does")]
    EndsEarly,
    /// An image whose size does not fit its pixels.
    #[error("an image of {width}x{height} has {pixels} pixels")]
    Image {
        /// Its width, as it says.
        width: u32,
        /// Its height, as it says.
        height: u32,
        /// How many pixels came.
        pixels: usize,
    },
    /// The file cannot be created or looked at.
    #[error("{0}")]
    File(#[source] io::Error),
    /// The disk took nothing.
    #[error("nothing was written")]
    Empty,
    /// No viewer takes connections.
    #[error("no viewer listens at {host}: {why}")]
    NoViewer {
        /// `HOST:PORT`.
        host: String,
        /// What connecting said.
        #[source]
        why: io::Error,
    },
    /// The viewer did not take what was left.
    #[error("the viewer has gone: {0}")]
    ViewerGone(#[source] SinkFlushError),
    /// The SDK could not write the rest of the file.
    #[error("{0}")]
    Rest(#[source] SinkFlushError),
    /// The SDK refuses what it is given.
    #[error("{0}")]
    Sdk(#[from] RecordingStreamError),
}
