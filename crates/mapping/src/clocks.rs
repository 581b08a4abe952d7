//! The time offset between the clocks of the IMU and the images, estimated while mapping by comparing the
//! rotations that both measure.
//!
//! Readings and rotations of the last seconds are buffered in the IMU's own clock. The offset is estimated as
//! they come in, and once it is known the preintegrations between key frames are recomputed.

use cairn_atlas::{Change, ImuFactor, ImuSegment, KeyFrameId, Snapshot};
use cairn_geometry::So3;
use cairn_inertial::{Bias, ImuBuffer, OffsetConfig, Preintegrated, time_offset};
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use std::collections::VecDeque;

/// Seconds that are buffered.
const BUFFER_S: f64 = 20.0;
/// Intervals in seconds after which the offset is estimated; the last attempt is final.
const ATTEMPTS_S: [f64; 6] = [2.5, 3.5, 5.0, 7.0, 10.0, 15.0];
/// Offsets smaller than this are taken as zero, seconds.
const NEGLIGIBLE_S: f64 = 0.0005;
/// Smallest change of a known offset, seconds.
const MIN_CHANGE_S: f64 = 0.0003;
/// Standard deviation of an offset that nobody has estimated, seconds: browsers stamp a picture up to two frames of the display after its
/// exposure.
const UNKNOWN_S: f64 = 0.03;
/// Standard deviation of the extrinsic rotation between IMU and camera in a rig's file, radians: an error
/// there and an offset partly compensate each other.
const EXTRINSIC_SIGMA_RAD: f64 = 0.02;

/// Recent readings and rotations, and the estimated time offset.
#[derive(Debug)]
pub(crate) struct Clocks {
    /// Readings in the IMU's own clock, as the source gives them.
    buffer: ImuBuffer,
    rotations: VecDeque<(Stamp, So3)>,
    map_created: Option<Stamp>,
    attempts: usize,
    /// The standard deviation of the offset in use, seconds; `None` while none was estimated.
    sigma_s: Option<f64>,
}

impl Clocks {
    pub fn new(sensor: &ImuSensor) -> Self {
        Self {
            buffer: ImuBuffer::in_stream(sensor),
            rotations: VecDeque::new(),
            map_created: None,
            attempts: 0,
            sigma_s: None,
        }
    }

    /// Whether the offset is known, or was estimated often enough without success to conclude that it is not
    /// observable.
    pub fn is_decided(&self) -> bool {
        self.sigma_s.is_some() || self.attempts > 2
    }

    /// The standard deviation of what the offset in use may be off, seconds.
    pub fn sigma_s(&self) -> f64 {
        self.sigma_s.unwrap_or(UNKNOWN_S)
    }

    /// Takes an offset that was estimated otherwise, with its standard deviation; returns it as [`Clocks::estimate`] does.
    pub fn settle(&mut self, offset_s: f64, sigma_s: f64, known_s: f64) -> Option<f64> {
        self.sigma_s = Some(sigma_s);
        ((offset_s - known_s).abs() > sigma_s.max(NEGLIGIBLE_S)).then_some(offset_s)
    }

    /// Takes the IMU data of a key frame.
    pub fn take(&mut self, imu: &ImuSegment) {
        let own = |s: &ImuSample| ImuSample { stamp: s.stamp.plus_seconds(-imu.offset_s), ..*s };
        self.buffer.push(&imu.samples.iter().map(own).collect::<Vec<_>>());
        self.rotations.extend(imu.turns.iter().copied());
        let Some(last) = self.rotations.back().map(|t| t.0) else { return };
        self.map_created.get_or_insert(last);
        self.buffer.forget_before(last.plus_seconds(-BUFFER_S));
        while self.rotations.front().is_some_and(|t| last - t.0 > BUFFER_S) {
            self.rotations.pop_front();
        }
    }

    /// The world frame has been rotated: earlier rotations cannot be compared with later ones.
    pub fn clear_rotations(&mut self) {
        self.rotations.clear();
    }

    /// Estimates the offset when that is due; returns a new value, in seconds to be added to the IMU's
    /// stamps, when it differs enough from `known_s`.
    pub fn estimate(&mut self, imu_from_camera: &So3, known_s: f64) -> Option<f64> {
        let (map_created, last) = (self.map_created?, self.rotations.back()?.0);
        if ATTEMPTS_S.get(self.attempts).is_none_or(|due| last - map_created < *due) {
            return None;
        }
        self.attempts += 1;
        let rotations: Vec<(Stamp, So3)> = self.rotations.iter().copied().collect();
        let samples: Vec<ImuSample> = self.buffer.samples().copied().collect();
        let config = OffsetConfig { rotation_sigma: EXTRINSIC_SIGMA_RAD, ..OffsetConfig::default() };
        let found = time_offset(&rotations, &samples, imu_from_camera, &config).ok()?;
        if self.sigma_s.is_some_and(|sigma_s| sigma_s < found.sigma_s) {
            return None;
        }
        self.sigma_s = Some(found.sigma_s);
        let wanted =
            if found.offset_s.abs() < NEGLIGIBLE_S.max(2.0 * found.sigma_s) { 0.0 } else { found.offset_s };
        let least = if known_s == 0.0 { NEGLIGIBLE_S } else { MIN_CHANGE_S };
        let changed = (wanted - known_s).abs() > least.max(found.sigma_s);
        changed.then_some(wanted)
    }

    /// Preintegration between two stamps of the images' clock; `None` where readings are missing.
    pub fn preintegrated(&self, bias: Bias, from: Stamp, to: Stamp, offset_s: f64) -> Option<Preintegrated> {
        let own = |t: Stamp| t.plus_seconds(-offset_s);
        let cut = self.buffer.between(own(from), own(to)).ok()?;
        // Both ends are exactly the images' stamps, regardless of rounding to nanoseconds.
        let last = cut.len() - 1;
        let stamp = |i: usize, s: &ImuSample| match i {
            0 => from,
            i if i == last => to,
            _ => s.stamp.plus_seconds(offset_s),
        };
        let samples = cut.iter().enumerate().map(|(i, s)| ImuSample { stamp: stamp(i, s), ..*s }).collect();
        Some(Preintegrated::of(self.buffer.noise(), bias, samples))
    }

    /// IMU factors between the key frames of a chain, recomputed for an offset; none for those older than the
    /// buffer.
    pub fn recompute_factors(&self, snapshot: &Snapshot, chain: &[KeyFrameId], offset_s: f64) -> Vec<Change> {
        let pairs =
            chain.windows(2).filter_map(|w| Some((snapshot.key_frame(w[0])?, snapshot.key_frame(w[1])?)));
        pairs
            .filter_map(|(before, k)| {
                let bias = k.motion.as_ref()?.bias;
                let sum = self.preintegrated(bias, before.stamp, k.stamp, offset_s)?;
                Some(Change::ImuFactor(k.id, ImuFactor { since: before.id, sum: sum.into() }))
            })
            .collect()
    }
}
