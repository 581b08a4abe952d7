//! Selected packets of a recording: those that a run processed when it dropped the others.

use cairn_sensor::{FramePacket, ImuSample, Rig, Skips, Source, SourceError, SourceInfo, Stamp};

/// Delivers the packets with these stamps; the IMU samples of the others are added to the next one delivered.
pub struct Picked {
    source: Box<dyn Source>,
    stamps: Vec<Stamp>,
    delivered: usize,
    passed: usize,
}

impl Picked {
    /// `stamps` in the order of the source.
    pub fn new(source: Box<dyn Source>, stamps: Vec<Stamp>) -> Self {
        Self { source, stamps, delivered: 0, passed: 0 }
    }
}

impl Source for Picked {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let Some(wanted) = self.stamps.get(self.delivered).copied() else { return Ok(None) };
        let mut before: Vec<ImuSample> = Vec::new();
        while let Some(mut packet) = self.source.next_packet()? {
            // Samples synthesised for an image that is left out are no longer needed.
            before.retain(|sample| !sample.is_synthesised());
            before.append(&mut packet.imu);
            if packet.stamp == wanted {
                packet.imu = before;
                self.delivered += 1;
                return Ok(Some(packet));
            }
            self.passed += 1;
        }
        Ok(None)
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }

    /// Packets that were not delivered.
    fn dropped(&self) -> usize {
        self.passed
    }

    fn skips(&self) -> Skips {
        self.source.skips()
    }
}
