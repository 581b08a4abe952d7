//! The clock of the inertial sensor against that of the images, found while mapping from how both turn.
//!
//! What the key frames bring is kept for some seconds in the sensor's own clock. The offset is sought as it comes in, and
//! once it is known what was felt between key frames is cut anew.

use cairn_atlas::{Change, ImuFactor, ImuSegment, KeyFrameId, Snapshot};
use cairn_geometry::So3;
use cairn_inertial::{Bias, ImuBuffer, OffsetConfig, Preintegrated, TimeOffset, time_offset};
use cairn_sensor::{ImuSample, ImuSensor, Stamp};
use std::collections::VecDeque;

/// Seconds that are kept.
const KEPT_S: f64 = 20.0;
/// Seconds after which the offset is sought, and how often then; the last look is final.
const LOOKS_S: [f64; 6] = [2.5, 3.5, 5.0, 7.0, 10.0, 15.0];
/// Offsets smaller than this are none, seconds.
const NONE_S: f64 = 0.0005;
/// A known offset is changed by this at least, seconds.
const BETTER_S: f64 = 0.0003;
/// How well a rig's file knows the rotation between sensor and eye, radians: what is free there is taken from the offset.
const MISALIGNED_RAD: f64 = 0.02;

/// What was felt and seen of late, and what is known of the clocks.
#[derive(Debug)]
pub(crate) struct Clocks {
    /// In the sensor's own clock, as the source gives it.
    buffer: ImuBuffer,
    turns: VecDeque<(Stamp, So3)>,
    map_created: Option<Stamp>,
    looks: usize,
    found: Option<TimeOffset>,
}

impl Clocks {
    pub fn new(sensor: &ImuSensor) -> Self {
        Self {
            buffer: ImuBuffer::in_stream(sensor),
            turns: VecDeque::new(),
            map_created: None,
            looks: 0,
            found: None,
        }
    }

    /// Whether the offset is known, or was sought for so long that there is none to be seen.
    pub fn final_result(&self) -> bool {
        self.found.is_some() || self.looks > 2
    }

    /// Takes what a key frame brings.
    pub fn take(&mut self, imu: &ImuSegment) {
        let own = |s: &ImuSample| ImuSample { stamp: s.stamp.plus_seconds(-imu.offset_s), ..*s };
        self.buffer.push(&imu.samples.iter().map(own).collect::<Vec<_>>());
        self.turns.extend(imu.turns.iter().copied());
        let Some(last) = self.turns.back().map(|t| t.0) else { return };
        self.map_created.get_or_insert(last);
        self.buffer.forget_before(last.plus_seconds(-KEPT_S));
        while self.turns.front().is_some_and(|t| last - t.0 > KEPT_S) {
            self.turns.pop_front();
        }
    }

    /// The frame of the map has turned: what was seen in it before tells nothing of what is seen from now on.
    pub fn turned(&mut self) {
        self.turns.clear();
    }

    /// Looks for the offset when that is due; a new one, to be added to the sensor's stamps.
    pub fn look(&mut self, imu_from_camera: &So3, known_s: f64) -> Option<f64> {
        let (map_created, last) = (self.map_created?, self.turns.back()?.0);
        if LOOKS_S.get(self.looks).is_none_or(|due| last - map_created < *due) {
            return None;
        }
        self.looks += 1;
        let turns: Vec<(Stamp, So3)> = self.turns.iter().copied().collect();
        let samples: Vec<ImuSample> = self.buffer.samples().copied().collect();
        let config = OffsetConfig { rotation_sigma: MISALIGNED_RAD, ..OffsetConfig::default() };
        let found = time_offset(&turns, &samples, imu_from_camera, &config).ok()?;
        self.found = Some(found);
        let wanted =
            if found.offset_s.abs() < NONE_S.max(2.0 * found.sigma_s) { 0.0 } else { found.offset_s };
        let least = if known_s == 0.0 { NONE_S } else { BETTER_S };
        let news = (wanted - known_s).abs() > least.max(found.sigma_s);
        news.then_some(wanted)
    }

    /// What was felt between two stamps of the images' clock; `None` where readings are missing.
    pub fn preintegrated(&self, bias: Bias, from: Stamp, to: Stamp, offset_s: f64) -> Option<Preintegrated> {
        let own = |t: Stamp| t.plus_seconds(-offset_s);
        let cut = self.buffer.between(own(from), own(to)).ok()?;
        // Both ends are the images' stamps, whatever becomes of a nanosecond on the way.
        let last = cut.len() - 1;
        let stamp = |i: usize, s: &ImuSample| match i {
            0 => from,
            i if i == last => to,
            _ => s.stamp.plus_seconds(offset_s),
        };
        let samples = cut.iter().enumerate().map(|(i, s)| ImuSample { stamp: stamp(i, s), ..*s }).collect();
        Some(Preintegrated::of(self.buffer.noise(), bias, samples))
    }

    /// What was felt between the key frames of a chain, cut anew for an offset; nothing for those that came too long ago.
    pub fn cut(&self, snapshot: &Snapshot, chain: &[KeyFrameId], offset_s: f64) -> Vec<Change> {
        let pairs =
            chain.windows(2).filter_map(|w| Some((snapshot.key_frame(w[0])?, snapshot.key_frame(w[1])?)));
        pairs
            .filter_map(|(before, k)| {
                let bias = k.motion.as_ref()?.bias;
                let sum = self.preintegrated(bias, before.frame.stamp, k.frame.stamp, offset_s)?;
                Some(Change::ImuFactor(k.id, ImuFactor { since: before.id, sum: sum.into() }))
            })
            .collect()
    }
}
