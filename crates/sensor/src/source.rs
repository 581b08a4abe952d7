//! The contract of everything that gives packets.

use crate::{FramePacket, Rig, Stamp};
use cairn_geometry::Se3;

/// Why a source could not be opened or read; the text names the file, the place and the cure.
#[derive(Debug, thiserror::Error)]
#[error("{what}: {why}; {cure}")]
pub struct SourceError {
    /// File, folder or stream, with the line where there is one.
    pub what: String,
    /// What is wrong with it.
    pub why: String,
    /// What the user can do.
    pub cure: String,
}

impl SourceError {
    /// From the three parts of a good message.
    pub fn new(what: impl Into<String>, why: impl Into<String>, cure: impl Into<String>) -> Self {
        Self { what: what.into(), why: why.into(), cure: cure.into() }
    }
}

/// What is known of a source before it is read.
#[derive(Clone, Debug)]
pub struct SourceInfo {
    /// What kind it is and where, for people ("EuRoC folder /data/mh01").
    pub name: String,
    /// How many packets it will give, when that is known.
    pub frames: Option<usize>,
    /// Frames a second, nominal.
    pub rate_hz: f64,
    /// True poses of the body in some world, by time, when the source has them.
    pub truth: Vec<(Stamp, Se3)>,
    /// What of the rig was assumed, where it was not read from a calibration or given; for people, who must be told.
    pub assumed: Option<String>,
}

/// A recording, a live stream or a simulated world.
pub trait Source: Send {
    /// What is known before reading.
    fn info(&self) -> &SourceInfo;

    /// The rig that sees; the same for the whole source.
    fn rig(&self) -> &Rig;

    /// The next packet in time, `None` at the end. A packet that can not be read is skipped and counted
    /// (see [`Source::skipped`]); an error means that the source as a whole has failed.
    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError>;

    /// What was skipped so far and why, one line each.
    fn skipped(&self) -> &[String];
}
