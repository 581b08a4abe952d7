//! The interface of everything that delivers packets.

use crate::{FramePacket, Live, Rig, SkipKind, Skips, Stamp};
use cairn_geometry::Se3;
use std::sync::Arc;

/// Why a source could not be opened or read; the text names the file, the position in it and the remedy.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {why}; {cure}")]
pub struct SourceError {
    /// File, folder or stream, with the line if there is one.
    pub what: String,
    /// What is wrong with it.
    pub why: String,
    /// What the user can do.
    pub cure: String,
}

impl SourceError {
    /// An error from its three parts.
    pub fn new(what: impl Into<String>, why: impl Into<String>, cure: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into(), cure: cure.into() }
    }
}

/// What is known about a source before it is read.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// Kind and location, for display ("EuRoC folder /data/mh01").
    pub name: String,
    /// Number of packets, if known.
    pub frames: Option<usize>,
    /// Nominal frame rate in Hz.
    pub rate_hz: f64,
    /// Ground-truth poses `world_from_body` by time, if the source has them.
    pub truth: Vec<(Stamp, Se3)>,
    /// Which part of the rig was assumed rather than read from a calibration or given; must be shown to the user.
    pub assumed: Option<String>,
}

/// A recording, a live stream or a simulated world.
pub trait Source: Send {
    /// What is known before reading.
    fn info(&self) -> &SourceInfo;

    /// The rig; constant for the whole source.
    fn rig(&self) -> &Rig;

    /// The next packet in time, `None` at the end. A packet that cannot be read is skipped and counted (see
    /// [`Source::skipped`]).
    ///
    /// # Errors
    /// When the source as a whole has failed.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError>;

    /// The packets skipped so far and why, one line each.
    fn skipped(&self) -> &[String];

    /// Packets that were left out until now because they did not come in time, or were not asked for.
    fn dropped(&self) -> usize {
        0
    }

    /// What a live source tells while another thread reads it; `None` for recordings, and for sources that know no more of
    /// a picture's time than when it came.
    fn live(&self) -> Option<Arc<dyn Live>> {
        None
    }

    /// The same counted by kind and reason. A source that counts nothing leaves its lines unclassified.
    fn skips(&self) -> Skips {
        let mut skips = Skips::default();
        for line in self.skipped() {
            skips.add_many(SkipKind::Other, "reported by the source", 1, line);
        }
        skips
    }
}
