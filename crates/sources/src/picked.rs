//! A recording of which only some packets are given, as they were when a run dropped the others.

use cairn_sensor::{FramePacket, ImuSample, Rig, Source, SourceError, SourceInfo, Stamp};

/// Gives the packets with these stamps; what the others have of IMU goes into the next that is given.
pub struct Picked {
    source: Box<dyn Source>,
    stamps: Vec<Stamp>,
    given: usize,
    passed: usize,
}

impl Picked {
    /// Stamps in the order of the source.
    pub fn new(source: Box<dyn Source>, stamps: Vec<Stamp>) -> Self {
        Self { source, stamps, given: 0, passed: 0 }
    }

    /// Packets that were not given.
    pub fn passed(&self) -> usize {
        self.passed
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
        let Some(wanted) = self.stamps.get(self.given).copied() else { return Ok(None) };
        let mut before: Vec<ImuSample> = Vec::new();
        while let Some(mut packet) = self.source.next_packet()? {
            // What was made up for an image that is left out is not needed any more.
            before.retain(|sample| !sample.is_synthesised());
            before.append(&mut packet.imu);
            if packet.stamp == wanted {
                packet.imu = before;
                self.given += 1;
                return Ok(Some(packet));
            }
            self.passed += 1;
        }
        Ok(None)
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }
}
