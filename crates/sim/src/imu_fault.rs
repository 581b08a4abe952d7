//! A fault of an IMU, put into the readings of any source: a recording or a simulated walk.
//!
//! In: a source, and what happens to its readings from when on and for how long. Out: the same images, with the readings as a
//! recorder would have written them: merged with the images by their stamps as every source does it.

use cairn_sensor::{
    FramePacket, ImuSample, Merge, MergeConfig, Rig, Source, SourceError, SourceInfo, Stamp, Stream,
};
use std::fmt;

/// Seconds between spikes.
const SPIKES_S: f64 = 0.25;
/// A spike, on one axis: rad/s and m/s^2.
const SPIKE: [f64; 2] = [35.0, 150.0];
/// Where readings are cut off in [`ImuFaultKind::Saturated`]: rad/s and m/s^2, less than a hand moves a camera.
const RANGE: [f64; 2] = [0.3, 9.0];

/// What happens to the readings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImuFaultKind {
    /// The last reading is repeated.
    Stuck,
    /// All numbers are zero.
    Zeros,
    /// Those of the accelerometer are zero.
    AccelDead,
    /// Those of the gyroscope are zero.
    GyroDead,
    /// No reading comes.
    Gap,
    /// Stamps are later by so many seconds, at once.
    Jump(f64),
    /// Stamps become later by so many seconds in each second.
    Drift(f64),
    /// One reading of the accelerometer in a quarter of a second is 150 m/s^2 on one axis.
    AccelSpikes,
    /// One reading of the gyroscope in a quarter of a second is 35 rad/s on one axis.
    GyroSpikes,
    /// The same once.
    GyroSpike,
    /// The gyroscope tells degrees.
    Degrees,
    /// Readings are cut off at 0.3 rad/s and 9 m/s^2.
    Saturated,
}

impl fmt::Display for ImuFaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stuck => f.write_str("stuck"),
            Self::Zeros => f.write_str("zeros"),
            Self::AccelDead => f.write_str("accelerometer dead"),
            Self::GyroDead => f.write_str("gyroscope dead"),
            Self::Gap => f.write_str("gap"),
            Self::Jump(s) => write!(f, "clock {:+.0} ms", 1e3 * s),
            Self::Drift(s) => write!(f, "clock drifts {:.0} ms/s", 1e3 * s),
            Self::AccelSpikes => f.write_str("accelerometer spikes"),
            Self::GyroSpikes => f.write_str("gyroscope spikes"),
            Self::GyroSpike => f.write_str("one gyroscope spike"),
            Self::Degrees => f.write_str("degrees"),
            Self::Saturated => f.write_str("saturated"),
        }
    }
}

/// A fault and its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuFault {
    /// What happens.
    pub kind: ImuFaultKind,
    /// Seconds after the first image.
    pub from_s: f64,
    /// For how long; infinite to the end.
    pub seconds: f64,
}

/// The readings of one IMU with the fault, one by one.
struct Faulty {
    fault: ImuFault,
    /// The last sound reading.
    sound: Option<ImuSample>,
    /// Spikes so far.
    spikes: usize,
}

impl Faulty {
    /// The reading as it comes, `since_s` seconds after the first image; `None` where none comes.
    fn pass(&mut self, sample: ImuSample, since_s: f64) -> Option<ImuSample> {
        let into_s = since_s - self.fault.from_s;
        if !(0.0..self.fault.seconds).contains(&into_s) {
            self.sound = Some(sample);
            return Some(sample);
        }
        let mut s = sample;
        let has_spike = self.is_due(into_s);
        match self.fault.kind {
            ImuFaultKind::Stuck => {
                let last = self.sound.unwrap_or(sample);
                (s.gyro, s.accel) = (last.gyro, last.accel);
            }
            ImuFaultKind::Zeros => (s.gyro, s.accel) = Default::default(),
            ImuFaultKind::AccelDead => s.accel = Default::default(),
            ImuFaultKind::GyroDead => s.gyro = Default::default(),
            ImuFaultKind::Gap => return None,
            ImuFaultKind::Jump(by) => s.stamp = s.stamp.plus_seconds(by),
            ImuFaultKind::Drift(by) => s.stamp = s.stamp.plus_seconds(by * into_s),
            ImuFaultKind::AccelSpikes if has_spike => s.accel.x = SPIKE[1],
            ImuFaultKind::GyroSpikes if has_spike => s.gyro.x = SPIKE[0],
            ImuFaultKind::GyroSpike if has_spike && self.spikes == 1 => s.gyro.x = SPIKE[0],
            ImuFaultKind::AccelSpikes | ImuFaultKind::GyroSpikes | ImuFaultKind::GyroSpike => {}
            ImuFaultKind::Degrees => s.gyro *= 1f64.to_degrees(),
            ImuFaultKind::Saturated => {
                let cut = |v: f64, most: f64| v.clamp(-most, most);
                (s.gyro, s.accel) = (s.gyro.map(|v| cut(v, RANGE[0])), s.accel.map(|v| cut(v, RANGE[1])));
            }
        }
        Some(s)
    }

    /// Whether the next spike is due.
    fn is_due(&mut self, into_s: f64) -> bool {
        let is_due = into_s >= SPIKES_S * self.spikes as f64;
        self.spikes += usize::from(is_due);
        is_due
    }
}

/// A source whose IMU has a fault.
pub struct FaultyImu {
    source: Box<dyn Source>,
    faulty: Faulty,
    merge: Merge<FramePacket, ()>,
    first: Option<Stamp>,
    ended: bool,
}

impl FaultyImu {
    /// Puts a fault into a source; one without an IMU stays as it is.
    pub fn new(source: Box<dyn Source>, fault: ImuFault) -> Self {
        let config = MergeConfig {
            imu_period_s: source.rig().imu.as_ref().map(|imu| 1.0 / imu.rate_hz),
            wait_s: f64::INFINITY,
            lead_s: f64::INFINITY,
            ..MergeConfig::default()
        };
        let faulty = Faulty { fault, sound: None, spikes: 0 };
        Self { source, faulty, merge: Merge::new(config), first: None, ended: false }
    }

    /// Reads one packet of the source into the merge.
    fn read(&mut self) -> Result<(), SourceError> {
        let Some(mut packet) = self.source.next_packet()? else {
            self.ended = true;
            self.merge.end(Stream::Camera(0));
            self.merge.end(Stream::Imu);
            return Ok(());
        };
        let first = *self.first.get_or_insert(packet.stamp);
        for sample in std::mem::take(&mut packet.imu).into_iter().filter(|s| !s.is_synthesised()) {
            let passed = self.faulty.pass(sample, sample.stamp - first);
            // The merge counts the readings that it drops, and no packet comes before another.
            let _ = passed.map(|s| self.merge.push_imu(s));
        }
        let _ = self.merge.push_image(0, packet.stamp, packet);
        Ok(())
    }
}

impl Source for FaultyImu {
    fn info(&self) -> &SourceInfo {
        self.source.info()
    }

    fn rig(&self) -> &Rig {
        self.source.rig()
    }

    fn next_packet(&mut self) -> Result<Option<FramePacket>, SourceError> {
        loop {
            if let Some(merged) = self.merge.pop() {
                let packet = merged.images.into_iter().next();
                return Ok(packet.map(|packet| FramePacket { imu: merged.imu, ..packet }));
            }
            if self.ended {
                return Ok(None);
            }
            self.read()?;
        }
    }

    fn skipped(&self) -> &[String] {
        self.source.skipped()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;

    /// The readings of 4 s at 200 Hz with a fault from 1 s on, each with its seconds.
    fn through(kind: ImuFaultKind, seconds: f64) -> Vec<(f64, ImuSample)> {
        let mut faulty = Faulty { fault: ImuFault { kind, from_s: 1.0, seconds }, sound: None, spikes: 0 };
        let reading = |i: i64| {
            let value = Vec3::new(0.4, 0.001 * i as f64, 0.0);
            ImuSample::new(Stamp(i * 5_000_000), value, value + Vec3::z() * 9.81)
        };
        (0..800)
            .filter_map(|i| Some((0.005 * i as f64, faulty.pass(reading(i), 0.005 * i as f64)?)))
            .collect()
    }

    #[test]
    fn a_fault_begins_and_ends_when_it_is_to() {
        for kind in [ImuFaultKind::Zeros, ImuFaultKind::Stuck, ImuFaultKind::Degrees, ImuFaultKind::Jump(0.5)]
        {
            let (with, without) = (through(kind, 2.0), through(kind, 0.0));
            for ((t, a), (_, b)) in with.iter().zip(&without) {
                assert_eq!(a != b, (1.0..3.0).contains(t), "{kind} at {t}");
            }
        }
        assert_eq!(through(ImuFaultKind::Gap, 2.0).len(), 400);
    }

    #[test]
    fn each_fault_does_what_it_says() {
        let at = |kind, i: usize| through(kind, f64::INFINITY)[i].1;
        let sound = through(ImuFaultKind::Gap, 0.0);
        assert_eq!(at(ImuFaultKind::Stuck, 500).gyro, sound[199].1.gyro);
        assert_eq!(at(ImuFaultKind::Zeros, 500).accel, Vec3::zeros());
        let dead = at(ImuFaultKind::AccelDead, 500);
        assert_eq!((dead.accel, dead.gyro), (Vec3::zeros(), sound[500].1.gyro));
        let dead = at(ImuFaultKind::GyroDead, 500);
        assert_eq!((dead.gyro, dead.accel), (Vec3::zeros(), sound[500].1.accel));
        assert_eq!(at(ImuFaultKind::Jump(-0.5), 500).stamp, Stamp(2_000_000_000));
        assert_eq!(at(ImuFaultKind::Drift(0.01), 400).stamp, Stamp(2_010_000_000));
        assert!((at(ImuFaultKind::Degrees, 500).gyro.x - 22.918).abs() < 1e-3);
        assert_eq!(at(ImuFaultKind::Saturated, 500).gyro.x, 0.3);
        let spikes =
            |kind| through(kind, 1.0).iter().filter(|(_, s)| s.gyro.x > 30.0 || s.accel.x > 100.0).count();
        let kinds = [ImuFaultKind::AccelSpikes, ImuFaultKind::GyroSpikes, ImuFaultKind::GyroSpike];
        assert_eq!(kinds.map(spikes), [4, 4, 1]);
    }
}
