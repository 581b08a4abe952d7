//! The time offset between the clocks of the IMU and the images, estimated while mapping by comparing the
//! rotations that both measure.
//!
//! Readings and rotations of the last seconds are buffered in the IMU's own clock. The offset is estimated as
//! they come in, and once it is known the preintegrations between key frames are recomputed.

use cairn_atlas::{Change, ImuFactor, ImuSegment, KeyFrame, KeyFrameId, Snapshot};
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
    pub fn adopt(&mut self, offset_s: f64, sigma_s: f64, known_s: f64) -> Option<f64> {
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

    /// Leaves out the readings of the newest key frames from then on, by the images' clock: they are not those of the motion, which was
    /// found out later.
    pub fn cut(&mut self, snapshot: &Snapshot, since: Stamp, offset_s: f64) -> Vec<Change> {
        self.buffer.forget_after(since.plus_seconds(-offset_s));
        let newest = (0..snapshot.next_key_frame_id().index()).rev();
        let newest = newest.filter_map(|i| snapshot.key_frame(KeyFrameId::from_index(i)?));
        let own = newest.filter(|k| k.other_camera.is_none());
        let has_factor = |k: &KeyFrame| k.motion.as_ref().is_some_and(|m| m.imu_factor.is_some());
        let after = own.take_while(|k| k.stamp > since).filter(|k| has_factor(k));
        after.map(|k| Change::ImuFactor(k.id, None)).collect()
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
                Some(Change::ImuFactor(k.id, Some(ImuFactor { since: before.id, sum: sum.into() })))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::imu_walk::{STEP_S, ToAndFro};
    use cairn_geometry::{Se3, Vec3};
    use cairn_inertial::Gravity;
    use cairn_sensor::ImuNoise;

    const NOISE: ImuNoise = ImuNoise { gyro: 3e-4, gyro_walk: 1e-4, accel: 3e-3, accel_walk: 1e-3 };
    /// What has to be added to the readings' stamps to have them in the images' clock.
    const OFFSET_S: f64 = 0.02;

    fn clocks() -> Clocks {
        Clocks::new(&ImuSensor {
            body_from_imu: Se3::identity(),
            rate_hz: 200.0,
            noise: NOISE,
            offset_s: 0.0,
        })
    }

    /// The camera looks to and fro, to either side and up and down.
    fn rotation(t: f64) -> So3 {
        So3::exp(&Vec3::new(0.3 * (2.1 * t).sin(), 0.6 * (1.3 * t).sin(), 0.2 * (1.7 * t).cos()))
    }

    /// What tracking hands over for a key frame: the orientations of twenty frames a second and readings whose stamps are late.
    fn segment(from_s: f64, to_s: f64) -> ImuSegment {
        let count = |rate: f64| ((to_s - from_s) * rate).round() as usize;
        let turns = (0..count(20.0)).map(|i| {
            let t = from_s + i as f64 / 20.0;
            (Stamp::from_seconds(t), rotation(t))
        });
        let reading = |i: usize| {
            let (t, h) = (from_s + i as f64 / 200.0, 1e-4);
            let rate = (rotation(t - h).inverse() * rotation(t + h)).log() / (2.0 * h);
            ImuSample::new(Stamp::from_seconds(t - OFFSET_S), rate, Vec3::y() * -9.8)
        };
        ImuSegment {
            velocity: Vec3::zeros(),
            bias: Bias::default(),
            still_sigma: None,
            up: None,
            samples: (0..=count(200.0)).map(reading).collect(),
            unsound_since: None,
            offset_s: 0.0,
            turns: turns.collect(),
        }
    }

    #[test]
    fn estimate_finds_the_offset_when_it_is_due_and_not_before() {
        let mut clocks = clocks();
        let mut found = None;
        for n in 0..12 {
            let from_s = 0.5 * f64::from(n);
            clocks.take(&segment(from_s, from_s + 0.5));
            let estimate = clocks.estimate(&So3::identity(), 0.0);
            // The first key frame is where time counts from; orientations end a frame before it.
            assert!(estimate.is_none() || from_s + 0.5 > ATTEMPTS_S[0], "at {from_s} s");
            found = found.or(estimate);
            assert_eq!(clocks.is_decided(), found.is_some(), "at {from_s} s");
        }
        let found = found.expect("an offset");
        assert!((found - OFFSET_S).abs() < 1e-3, "{found} s");
        assert!(clocks.sigma_s() < UNKNOWN_S);
        assert_eq!(clocks.estimate(&So3::identity(), found), None, "nothing new");
    }

    #[test]
    fn preintegrated_spans_the_images_stamps_and_is_none_where_readings_are_missing() {
        let mut clocks = clocks();
        clocks.take(&segment(0.0, 1.0));
        clocks.take(&segment(1.5, 2.5));
        let [from, to] = [0.2, 0.7].map(Stamp::from_seconds);
        let sum = clocks.preintegrated(Bias::default(), from, to, OFFSET_S).expect("readings");
        let ends = [&sum.samples()[0], &sum.samples()[sum.samples().len() - 1]].map(|s| s.stamp);
        assert_eq!(ends, [from, to]);
        // The rotation of the camera between the two stamps, which those without the offset do not give.
        let state = cairn_inertial::NavState {
            world_from_imu: Se3::new(rotation(0.2), Vec3::zeros()),
            velocity: Vec3::zeros(),
            bias: Bias::default(),
        };
        let off = |sum: &Preintegrated| {
            let turned = sum.predict(&state, &Gravity::level().vector()).world_from_imu.rotation;
            (turned.inverse() * rotation(0.7)).angle()
        };
        assert!(off(&sum) < 1e-4, "{}", off(&sum));
        assert!(off(&clocks.preintegrated(Bias::default(), from, to, 0.0).unwrap()) > 1e-3);
        assert!(clocks.preintegrated(Bias::default(), from, Stamp::from_seconds(3.5), OFFSET_S).is_none());
    }

    #[test]
    fn cut_leaves_out_the_factors_and_readings_from_then_on() {
        let (mut atlas, ids) = ToAndFro { turn_rad: 0.5, tilt_rad: 0.0, factor: 1.0 }.map(8);
        let linked = |atlas: &cairn_atlas::Atlas| -> Vec<bool> {
            let has = |k: &KeyFrame| k.motion.as_ref().is_some_and(|m| m.imu_factor.is_some());
            ids.iter().map(|id| atlas.latest().key_frame(*id).is_some_and(has)).collect()
        };
        assert_eq!(linked(&atlas), [false, true, true, true, true, true, true, true]);
        let mut clocks = clocks();
        clocks.take(&segment(0.0, 2.0));
        // Between the fifth key frame and the sixth: what links them is partly of before.
        let changes = clocks.cut(atlas.latest(), Stamp::from_seconds(4.5 * STEP_S), OFFSET_S);
        assert_eq!(atlas.commit(changes).dropped, 0);
        assert_eq!(linked(&atlas), [false, true, true, true, true, false, false, false]);
        // Nor do they come back with another offset of the clocks.
        assert_eq!(clocks.recompute_factors(atlas.latest(), &ids, OFFSET_S).len(), 4);
        assert!(clocks.cut(atlas.latest(), Stamp::from_seconds(4.5 * STEP_S), OFFSET_S).is_empty());
    }

    #[test]
    fn adopt_takes_an_offset_that_differs_by_more_than_its_deviation() {
        let mut clocks = clocks();
        assert!(!clocks.is_decided());
        assert_eq!(clocks.adopt(0.012, 0.001, 0.0), Some(0.012));
        assert_eq!(clocks.adopt(0.0125, 0.001, 0.012), None);
        assert!(clocks.is_decided() && clocks.sigma_s() == 0.001);
    }

    #[test]
    fn clear_rotations_forgets_what_was_to_be_compared() {
        let mut clocks = clocks();
        (0..6).for_each(|n| clocks.take(&segment(0.5 * f64::from(n), 0.5 * f64::from(n + 1))));
        clocks.clear_rotations();
        assert_eq!(clocks.estimate(&So3::identity(), 0.0), None);
        clocks.take(&segment(3.0, 3.5));
        assert!(clocks.rotations.iter().all(|(at, _)| *at >= Stamp::from_seconds(3.0)));
    }

    #[test]
    fn recompute_factors_spans_consecutive_key_frames_of_which_there_are_readings() {
        let (atlas, ids) = ToAndFro { turn_rad: 0.5, tilt_rad: 0.0, factor: 1.0 }.map(6);
        let mut clocks = clocks();
        clocks.take(&segment(0.4, 2.0));
        let changes = clocks.recompute_factors(atlas.latest(), &ids, OFFSET_S);
        // Key frames stand at multiples of 0.25 s, and the readings begin at 0.4 s.
        let of = |change: &Change| match change {
            Change::ImuFactor(id, Some(factor)) => (*id, factor.since, factor.sum.seconds()),
            other => panic!("{other:?}"),
        };
        let found: Vec<_> = changes.iter().map(of).collect();
        assert_eq!(
            found.iter().map(|f| (f.0, f.1)).collect::<Vec<_>>(),
            [(ids[3], ids[2]), (ids[4], ids[3]), (ids[5], ids[4])]
        );
        assert!(found.iter().all(|f| (f.2 - STEP_S).abs() < 1e-6), "{found:?}");
    }
}
