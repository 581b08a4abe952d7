//! A recording played in real time: no packet before its time, and none that has already been overtaken, as far as it can be
//! read so fast.

use crate::Cancel;
use cairn_sensor::{FramePacket, ImuSample, Rig, Skips, Source, SourceError, SourceInfo, Stamp};
use std::time::{Duration, Instant};

/// How often a wait looks whether it was cancelled.
const LOOK: Duration = Duration::from_millis(50);

/// A recording that is read more slowly than it plays, as beside a compiler, never gets to the packet of now: after so long the
/// newest that was read is given.
const CATCH_UP: Duration = Duration::from_millis(150);

/// Plays a source in real time. A packet whose successor is due as well is dropped and counted; its IMU samples are added
/// to the successor, so none is lost.
pub struct Paced {
    source: Box<dyn Source>,
    /// When the first packet was delivered, and its stamp.
    started: Option<(Instant, Stamp)>,
    /// Read, but not yet delivered.
    next: Option<FramePacket>,
    dropped: usize,
    cancel: Cancel,
}

impl Paced {
    /// Time starts when the first packet is taken.
    pub fn new(source: Box<dyn Source>) -> Self {
        Self { source, started: None, next: None, dropped: 0, cancel: Cancel::default() }
    }

    /// Once cancelled, the source is at its end; waiting for the time of a packet ends too.
    pub fn cancelled_by(self, cancel: Cancel) -> Self {
        Self { cancel, ..self }
    }

    /// Time until a stamp is due; `None` when it is.
    fn until(&self, stamp: Stamp) -> Option<Duration> {
        let (instant, first) = self.started?;
        let due = Duration::try_from_secs_f64(stamp - first).ok()?;
        due.checked_sub(instant.elapsed()).filter(|d| !d.is_zero())
    }
}

impl Source for Paced {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        let asked = Instant::now();
        let packet = match self.next.take() {
            Some(packet) => Some(packet),
            None => self.source.next_packet()?,
        };
        let Some(mut packet) = packet else { return Ok(None) };
        self.started.get_or_insert((Instant::now(), packet.stamp));
        while asked.elapsed() < CATCH_UP {
            let Some(mut next) = self.source.next_packet()? else { break };
            if self.until(next.stamp).is_some() {
                self.next = Some(next);
                break;
            }
            self.dropped += 1;
            let mut imu: Vec<ImuSample> = std::mem::take(&mut packet.imu);
            // Samples synthesised for the image that is left out are no longer needed.
            imu.retain(|sample| !sample.is_synthesised());
            imu.append(&mut next.imu);
            next.imu = imu;
            packet = next;
        }
        while let Some(wait) = self.until(packet.stamp) {
            if self.cancel.is_cancelled() {
                return Ok(None);
            }
            std::thread::sleep(wait.min(LOOK));
        }
        Ok(Some(packet))
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }

    /// Packets that were overtaken before they were requested.
    fn dropped(&self) -> usize {
        self.dropped
    }

    fn skips(&self) -> Skips {
        self.source.skips()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;
    use cairn_sensor::Camera;

    /// Packets 10 ms apart, each with one IMU sample: the next one, how many there are, and how long each takes to read.
    struct RegularSource(SourceInfo, Rig, i64, i64, Duration);

    fn regular() -> Paced {
        slow(20, Duration::ZERO)
    }

    fn slow(count: i64, read: Duration) -> Paced {
        let info = SourceInfo {
            name: "regular".into(),
            frames: Some(count as usize),
            rate_hz: 100.0,
            truth: vec![],
            assumed: None,
        };
        let rig = Rig::mono(Camera::pinhole(8, 8, 8.0, 8.0, 4.0, 4.0));
        Paced::new(Box::new(RegularSource(info, rig, 0, count, read)))
    }

    impl Source for RegularSource {
        fn info(&self) -> &SourceInfo {
            &self.0
        }
        fn rig(&self) -> &Rig {
            &self.1
        }
        fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
            std::thread::sleep(self.4);
            let stamp = Stamp(7_000_000_000 + self.2 * 10_000_000);
            self.2 += 1;
            let imu = vec![ImuSample::new(stamp, Vec3::zeros(), Vec3::zeros())];
            let packet = FramePacket { stamp, images: vec![], depth: None, imu, decode_ms: 0.0 };
            Ok((self.2 <= self.3).then_some(packet))
        }
        fn skipped(&self) -> &[String] {
            &[]
        }
    }

    #[test]
    fn no_packet_comes_before_its_time() {
        let (mut source, start) = (regular(), Instant::now());
        let mut delivered = 0;
        while let Some(packet) = source.next_packet().unwrap() {
            assert!(start.elapsed().as_secs_f64() >= packet.stamp.seconds() - 7.0 - 1e-6);
            delivered += 1;
        }
        assert!(start.elapsed() >= Duration::from_millis(190));
        assert_eq!(delivered + source.dropped(), 20);
    }

    #[test]
    fn slow_reader_loses_images_but_no_imu_samples() {
        let mut source = regular();
        let (mut delivered, mut samples) = (0, Vec::new());
        while let Some(packet) = source.next_packet().unwrap() {
            delivered += 1;
            samples.extend(packet.imu.iter().map(|s| s.stamp));
            std::thread::sleep(Duration::from_millis(45));
        }
        assert!(source.dropped() >= 10, "{} of 20 delivered", delivered);
        assert_eq!(delivered + source.dropped(), 20);
        assert_eq!(samples.len(), 20);
        assert!(samples.windows(2).all(|w| w[0] < w[1]));
    }

    #[test]
    fn a_recording_that_is_read_too_slowly_still_gives_a_picture_every_200_ms() {
        // Four times as slow as it plays.
        let mut source = slow(40, Duration::from_millis(40));
        let (mut last, mut longest, mut stamps) = (Instant::now(), Duration::ZERO, Vec::new());
        let mut samples = 0;
        while let Some(packet) = source.next_packet().unwrap() {
            longest = longest.max(last.elapsed());
            last = Instant::now();
            samples += packet.imu.len();
            stamps.push(packet.stamp);
        }
        assert!(longest < Duration::from_millis(250), "{longest:?}");
        assert!(stamps.len() >= 7, "{} of 40 given", stamps.len());
        assert!(stamps.windows(2).all(|w| w[0] < w[1]) && samples == 40, "{samples} samples");
        assert_eq!(stamps.len() + source.dropped(), 40);
    }
}
