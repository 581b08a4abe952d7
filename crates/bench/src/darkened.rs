//! A source whose camera is covered for some time: its images are dark and without depth.

use cairn_sensor::{FramePacket, Rig, Skips, Source, SourceError, SourceInfo, Stamp};
use std::sync::Arc;

/// Gray value of what a covered camera sees.
const DARK: u8 = 3;

/// The source, and when.
pub(crate) struct Darkened {
    inner: Box<dyn Source>,
    /// Start and end, seconds after the first frame.
    dark_s: Option<[f64; 2]>,
    first: Option<Stamp>,
}

impl Darkened {
    pub(crate) fn new(inner: Box<dyn Source>, dark_s: Option<[f64; 2]>) -> Self {
        Self { inner, dark_s, first: None }
    }
}

impl Source for Darkened {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn rig(&self) -> &Rig {
        self.inner.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some(mut packet) = self.inner.next_packet()? else { return Ok(None) };
        let t = packet.stamp - *self.first.get_or_insert(packet.stamp);
        if self.dark_s.is_some_and(|[from, to]| t >= from && t <= to) {
            for image in &mut packet.images {
                Arc::make_mut(image).data_mut().fill(DARK);
            }
            packet.depth = None;
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        self.inner.skipped()
    }

    fn skips(&self) -> Skips {
        self.inner.skips()
    }
}
