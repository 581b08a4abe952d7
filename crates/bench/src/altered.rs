//! A source that is altered: its camera is covered for some time, its rig states something else, frames are dropped.

use cairn_random::Random;
use cairn_sensor::{FramePacket, Rig, Skips, Source, SourceError, SourceInfo, Stamp};
use std::sync::Arc;

/// Gray value of what a covered camera sees.
const DARK: u8 = 3;
/// One frame in so many is dropped.
const DROPPED: usize = 8;

/// The source, and what is altered.
pub(crate) struct Altered {
    inner: Box<dyn Source>,
    rig: Rig,
    /// Start and end, seconds after the first frame: images are dark and without depth.
    covered_s: Option<[f64; 2]>,
    /// Draws the frames that are dropped, as a player in real time does that is loaded.
    drops: Option<Random>,
    first: Option<Stamp>,
}

impl Altered {
    /// With this rig; `drops` is the seed of the frames that are dropped.
    pub(crate) fn new(
        inner: Box<dyn Source>,
        rig: Rig,
        covered_s: Option<[f64; 2]>,
        drops: Option<u64>,
    ) -> Self {
        let drops = drops.map(|seed| Random::new(seed ^ 0xD0));
        Self { inner, rig, covered_s, drops, first: None }
    }
}

impl Source for Altered {
    fn info(&self) -> &SourceInfo {
        self.inner.info()
    }

    fn rig(&self) -> &Rig {
        &self.rig
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some(mut packet) = self.inner.next_packet()? else { return Ok(None) };
        // The first frame is never dropped.
        while self.first.is_some() && self.drops.as_mut().is_some_and(|rng| rng.below(DROPPED) == 0) {
            let Some(mut next) = self.inner.next_packet()? else { break };
            let mut imu = std::mem::take(&mut packet.imu);
            // Samples synthesised for the image that is left out are no longer needed.
            imu.retain(|sample| !sample.is_synthesised());
            imu.append(&mut next.imu);
            next.imu = imu;
            packet = next;
        }
        let t = packet.stamp - *self.first.get_or_insert(packet.stamp);
        if self.covered_s.is_some_and(|[from, to]| t >= from && t <= to) {
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
