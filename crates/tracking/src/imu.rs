//! The inertial filter of tracking: the readings of the last seconds, and the state they predict between
//! frames.
//!
//! While the map is not gravity-aligned the readings are only buffered, for mapping. In a gravity-aligned map
//! there is a [`NavEstimate`]: it starts from the newest key frame that mapping has adjusted with its IMU
//! factors, is propagated to each frame by the readings, and corrected by the pose that is tracked there.

use crate::imu_trust::{Belief, ImuTrust};
use crate::on_the_spot::PureRotation;
use crate::state::{AnchoredPose, anchored_at};
use cairn_atlas::{ImuSegment, KeyFrame, Snapshot};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{
    Bias, Failed, ImuBuffer, Level, NavEstimate, Preintegrated, Rest, RestConfig, of_data_sheet,
};
use cairn_sensor::{ImuNoise, ImuSample, ImuSensor, MotionProfile, Stamp};
use nalgebra::SMatrix;
use std::collections::VecDeque;

/// White noise of readings that carry the pose by themselves, in that of the data sheet: how far it may be off by then is better stated
/// too large.
const NOISE_TIMES: f64 = 5.0;
/// Seconds during which rotations are collected to estimate the time offset of the clocks.
const CLOCKS_S: f64 = 16.0;
/// Orientations buffered between two key frame requests, at most.
const MAX_ROTATIONS: usize = 400;
/// Seconds of readings that are buffered.
const BUFFER_S: f64 = 20.0;
/// Standard deviations of a key frame's state after adjustment: metres, radians, m/s, rad/s, m/s^2.
const ADJUSTED_SIGMAS: [f64; 5] = [0.003, 0.002, 0.02, 0.001, 0.05];
/// Landmarks that a key frame must observe for its adjusted state to be used: with fewer it relies on the IMU
/// alone.
const ADJUSTED_LANDMARKS: usize = 30;
/// The standard deviations where only the pose was tracked.
const TRACKED_SIGMAS: [f64; 5] = [0.005, 0.003, 1.0, 0.003, 0.05];
/// What a map that mapping has aligned with gravity tells of gravity and of the accelerometer's bias.
const LEVELLED: Level = Level { bias: 0.1, bias_along: 0.05, tilt: 0.002 };
/// Age in seconds up to which an adjusted key frame corrects the state.
const MAX_AGE_S: f64 = 2.0;
/// Standard deviation of the velocity in a zero-velocity update, m/s.
const ZERO_VELOCITY_SIGMA_M_S: f64 = 0.003;
/// A sensor without readings for so long counts as absent, seconds.
const SILENT_S: f64 = 1.0;
/// Seconds of specific force averaged to estimate the up direction.
const MEAN_FORCE_S: f64 = 0.5;
/// Standard deviation of the velocity of a walker who turns on the spot, by the images, m/s.
const ON_THE_SPOT_SIGMA_M_S: f64 = 0.15;
/// The same where the images told so some moments ago: he may have set out since.
const ON_THE_SPOT_BEFORE_SIGMA_M_S: f64 = 0.3;
/// Seconds of angular velocity around an instant that are averaged.
const TURNING_S: f64 = 0.03;
/// One who stands is not pushed by more than this over the last moments: seconds, and m/s^2. An estimate that is level to a degree and a
/// half is off by less.
const STARTS_MOVING: (f64, f64) = (0.25, 0.25);

/// Seconds between the states that are kept for a fault of the readings, and how many are kept: as long as one goes unnoticed.
const BEFORE_S: f64 = 0.5;
const BEFORE: usize = 6;

/// The estimate at the last frame.
#[derive(Debug)]
struct Last {
    stamp: Stamp,
    estimate: NavEstimate,
    anchored: AnchoredPose,
    /// When the pose was last tracked: at this frame, unless the readings alone have led here since.
    tracked: Stamp,
}

impl Last {
    /// The same frame with the state that the readings predict for it from an adjusted key frame, corrected by its pose if
    /// that was tracked. A pose that the readings predicted says nothing new, and is replaced.
    fn restarted(&self, snapshot: &Snapshot, carried: NavEstimate) -> Option<Self> {
        let Self { stamp, anchored, tracked, .. } = *self;
        if tracked == stamp {
            let estimate = carried.seen(&anchored.world_from_camera, &pose_covariance())?;
            return Some(Self { stamp, estimate, anchored, tracked });
        }
        let anchored = anchored_at(snapshot, anchored.reference, carried.world_from_camera)?;
        Some(Self { stamp, estimate: carried, anchored, tracked })
    }
}

/// Readings and state estimate.
#[derive(Debug)]
pub(crate) struct InertialFilter {
    buffer: ImuBuffer,
    noise: ImuNoise,
    pub imu_from_camera: Se3,
    last: Option<Last>,
    /// The snapshot version that the estimate has been updated with.
    version: u64,
    /// Start of the readings that belong to the next key frame request.
    requested: Option<Stamp>,
    bias: Bias,
    /// Time offset that was added to the stamps of the readings.
    offset_s: f64,
    /// By how much their clock has jumped since the first of them, which is added as well.
    jumped_s: f64,
    /// Seconds in motion for which the pose was only predicted since it was last tracked.
    carried_s: f64,
    /// When the first orientation was recorded.
    map_created: Option<Stamp>,
    /// Orientations since the last key frame request, from vision alone.
    rotations: Vec<(Stamp, So3)>,
    /// Whether the readings are believed.
    trust: ImuTrust,
    /// States of the last moments, whose biases hold when the readings fail: what failed had been part of the newest for a while.
    before: VecDeque<(Stamp, NavEstimate)>,
    /// Estimated speed up to which the camera may be stationary, m/s.
    pub standing_m_s: f64,
}

impl InertialFilter {
    /// `imu_from_camera` in metres.
    pub fn new(sensor: &ImuSensor, imu_from_camera: Se3) -> Self {
        let noise = of_data_sheet(&sensor.noise).times([NOISE_TIMES; 2]);
        Self {
            buffer: ImuBuffer::in_stream(&ImuSensor { noise, ..*sensor }),
            noise: sensor.noise,
            imu_from_camera,
            last: None,
            version: 0,
            requested: None,
            bias: Bias::default(),
            offset_s: 0.0,
            jumped_s: 0.0,
            carried_s: 0.0,
            map_created: None,
            rotations: Vec::new(),
            trust: ImuTrust::default(),
            before: VecDeque::new(),
            standing_m_s: MotionProfile::default().standing_m_s,
        }
    }

    /// Takes the readings of a packet, and the offset of the clocks as it is known now.
    pub fn take(&mut self, samples: &[ImuSample], offset: f64) {
        if offset != self.offset_s {
            self.shift_to(offset);
        }
        // Readings that the source synthesised at image stamps are useless once the clock is shifted.
        let added = offset + self.jumped_s;
        let usable = samples.iter().filter(|s| added == 0.0 || !s.is_synthesised());
        let shifted = usable.map(|s| ImuSample { stamp: s.stamp.plus_seconds(added), ..*s });
        let was_believed = self.trust.fault().is_none();
        let believed: Vec<ImuSample> = shifted.filter(|s| s.is_synthesised() || self.trust.take(s)).collect();
        self.buffer.push(&believed);
        if was_believed && self.trust.fault().is_some() {
            self.give_up();
        }
        if let Some(last) = samples.last() {
            self.buffer.forget_before(Stamp(last.stamp.0 - (BUFFER_S * 1e9) as i64));
        }
    }

    /// Takes an offset of the clocks that no map knows yet; what [`Self::take`] is given later has to agree.
    pub fn shift_to(&mut self, offset_s: f64) {
        self.shift(offset_s - self.offset_s);
        self.offset_s = offset_s;
    }

    /// Moves the readings so far, as those that come will be.
    fn shift(&mut self, seconds: f64) {
        self.buffer.shift(seconds);
        self.trust.shift(seconds);
    }

    /// The readings that are buffered.
    pub fn samples(&self) -> impl Iterator<Item = &ImuSample> {
        self.buffer.samples()
    }

    /// Follows the changes of the map: the estimate moves along with the key frame it is anchored to, and restarts
    /// from a newer key frame once mapping has adjusted one.
    pub fn refresh(&mut self, snapshot: &Snapshot) {
        if snapshot.version() == self.version {
            return;
        }
        self.version = snapshot.version();
        self.imu_from_camera = snapshot.imu_from_camera().copied().unwrap_or(self.imu_from_camera);
        if let Some(last) = &mut self.last
            && let Some(resolved) =
                snapshot.resolve(last.anchored.reference, &last.anchored.reference_from_camera)
        {
            last.anchored.world_from_camera = resolved;
            last.estimate.carry_to(resolved);
        }
        if self.trust.fault().is_some() {
            return;
        }
        let newest = snapshot.newest_key_frame().filter(|k| snapshot.is_gravity_aligned(k.map));
        let newest = newest.filter(|k| k.landmarks.iter().flatten().count() >= ADJUSTED_LANDMARKS);
        let Some((k, motion)) = newest.and_then(|k| Some((k, k.motion.as_ref()?))) else { return };
        self.bias = motion.bias;
        let velocity = k.world_from_camera.rotation * motion.velocity;
        let adjusted = self.state(k.world_from_camera, velocity, motion.bias, ADJUSTED_SIGMAS);
        match &self.last {
            // Made where the readings alone had led: its landmarks are where that pose put them, so adjusting it to
            // them makes the pose no better known.
            Some(last) if last.tracked < k.stamp => {}
            Some(last) if last.stamp > k.stamp => {
                let current = snapshot.key_frame(last.anchored.reference).map(|r| r.map);
                if last.stamp - k.stamp > MAX_AGE_S || current != Some(k.map) {
                    return;
                }
                let Some(carried) = self.carried(&adjusted, k.stamp, last.stamp) else { return };
                if let Some(better) = last.restarted(snapshot, carried) {
                    self.last = Some(better);
                }
            }
            _ => {
                let (stamp, anchored) = (k.stamp, AnchoredPose::at(k.id, k.world_from_camera));
                self.last = Some(Last { stamp, estimate: adjusted, anchored, tracked: stamp });
            }
        }
    }

    /// The state at an instant from the readings alone; `None` where the map is not gravity-aligned or
    /// readings are missing.
    pub fn predict(&self, stamp: Stamp) -> Option<NavEstimate> {
        let last = self.last.as_ref()?;
        let carried = self.carried(&last.estimate, last.stamp, stamp)?;
        if !self.is_at_rest(stamp, &carried) {
            return Some(carried);
        }
        carried.at_rest(ZERO_VELOCITY_SIGMA_M_S)
    }

    /// A predicted state of a camera that has turned on the spot, by its images.
    pub fn on_the_spot(predicted: &NavEstimate) -> Option<NavEstimate> {
        predicted.at_rest(ON_THE_SPOT_SIGMA_M_S)
    }

    /// The camera's motion since the last frame, from the readings; `None` as for [`Self::predict`], and when the
    /// last frame is not the one of `from`.
    pub fn moved(&self, from: Stamp, stamp: Stamp) -> Option<Se3> {
        let last = self.last.as_ref().filter(|last| last.stamp == from)?;
        Some(last.estimate.world_from_camera.inverse() * self.predict(stamp)?.world_from_camera)
    }

    /// By how much the camera has turned between two instants, by the gyroscope, whether or not the map is gravity-aligned; `None`
    /// where readings are missing.
    pub fn turned(&self, from: Stamp, to: Stamp) -> Option<So3> {
        let (turned, ..) = self.sum(self.bias, from, to)?.gained(&self.bias);
        let camera_from_imu = self.imu_from_camera.rotation.inverse();
        Some(camera_from_imu * turned * self.imu_from_camera.rotation)
    }

    /// Seconds in motion for which the pose was only predicted since it was last tracked.
    pub fn carried_s(&self, stamp: Stamp) -> f64 {
        self.carried_s + self.last.as_ref().map_or(0.0, |last| stamp - last.stamp)
    }

    /// Whether the camera is stationary, by the readings and the estimate.
    pub fn is_stationary(&self, stamp: Stamp) -> bool {
        self.last.as_ref().is_some_and(|last| last.stamp == stamp && self.is_at_rest(stamp, &last.estimate))
    }

    /// Compares the readings with the pose of a frame as vision alone has it. True where they are found wrong that were believed: what
    /// they predicted is not to be used.
    pub fn see(&mut self, snapshot: &Snapshot, stamp: Stamp, alone: &AnchoredPose) -> bool {
        let estimate = self.last.as_ref().map(|last| &last.estimate);
        let belief = Belief {
            bias: estimate.map_or(self.bias, |e| e.bias),
            gravity: estimate.map(|e| e.gravity.vector()),
            imu_from_camera: self.imu_from_camera,
        };
        let camera = alone.world_from_camera.rotation;
        if let Some(by) = self.trust.clock_jump(stamp, &self.buffer, &belief, camera) {
            self.shift(by);
            self.jumped_s += by;
        }
        let fails = self.trust.see(snapshot, stamp, alone, &self.buffer, &belief);
        if fails {
            self.give_up();
        }
        fails
    }

    /// The readings have failed: what they may have led the biases to is undone.
    fn give_up(&mut self) {
        let since = self.trust.fault().map(|failed| failed.since);
        let sound = self.before.iter().rposition(|(at, _)| since.is_none_or(|since| *at <= since));
        let Some((_, before)) = self.before.drain(..).nth(sound.unwrap_or(0)) else { return };
        self.bias = before.bias;
        if let Some(last) = &mut self.last {
            last.estimate = last.estimate.clone().with_biases_of(&before);
        }
    }

    /// Keeps a state of a frame that was tracked while the readings are believed.
    fn remember(&mut self, stamp: Stamp, estimate: &NavEstimate) {
        let is_due = self.before.back().is_none_or(|(at, _)| stamp - *at > BEFORE_S);
        if self.trust.fault().is_none() && is_due {
            self.before.push_back((stamp, estimate.clone()));
            let old = self.before.len().saturating_sub(BEFORE);
            self.before.drain(..old);
        }
    }

    /// What is wrong with the readings, and since when; `None` while they are believed.
    pub fn fault(&self) -> Option<Failed> {
        self.trust.fault()
    }

    /// Readings that were left out one by one.
    pub fn refused(&self) -> usize {
        self.trust.refused()
    }

    /// Corrects the state by a tracked pose with this information matrix; `predicted` is the state before the
    /// frame.
    pub fn update(
        &mut self,
        snapshot: &Snapshot,
        stamp: Stamp,
        anchored: &AnchoredPose,
        predicted: Option<&NavEstimate>,
        information: &SMatrix<f64, 6, 6>,
    ) {
        let covariance = information.try_inverse();
        let corrected = predicted.zip(covariance).and_then(|(p, c)| p.seen(&anchored.world_from_camera, &c));
        let gravity_aligned =
            snapshot.key_frame(anchored.reference).is_some_and(|k| snapshot.is_gravity_aligned(k.map));
        let estimate = match (corrected, &self.last) {
            (Some(corrected), _) => corrected,
            // Tracked again after a gap: the velocity is not known. What the readings alone have led to for long says
            // nothing of it: after seconds without a view it may be faster than anyone walks.
            (None, Some(last)) => {
                let turn =
                    anchored.world_from_camera.rotation * last.anchored.world_from_camera.rotation.inverse();
                let is_recent = stamp - last.tracked <= MAX_AGE_S;
                let way =
                    anchored.world_from_camera.translation - last.anchored.world_from_camera.translation;
                let velocity = match last.tracked == last.stamp && self.trust.fault().is_some() {
                    // Nothing but vision has told of it for a while.
                    true if stamp > last.stamp => way / (stamp - last.stamp),
                    _ if is_recent => turn * last.estimate.velocity,
                    _ => Vec3::zeros(),
                };
                self.state(anchored.world_from_camera, velocity, self.bias, TRACKED_SIGMAS)
                    .with_biases_of(&last.estimate)
            }
            (None, None) => self.state(anchored.world_from_camera, Vec3::zeros(), self.bias, TRACKED_SIGMAS),
        };
        self.carried_s = 0.0;
        if gravity_aligned {
            self.remember(stamp, &estimate);
        }
        self.last = gravity_aligned.then_some(Last { stamp, estimate, anchored: *anchored, tracked: stamp });
    }

    /// The pose is not known after all.
    pub fn forget(&mut self) {
        self.last = None;
    }

    /// Whether orientations from vision alone are still wanted: until the time offset is known.
    pub fn wants_rotations(&mut self, stamp: Stamp) -> bool {
        stamp - *self.map_created.get_or_insert(stamp) < CLOCKS_S && self.rotations.len() < MAX_ROTATIONS
    }

    /// Records the orientation at a stamp from vision alone.
    pub fn add_rotation(&mut self, stamp: Stamp, world_from_camera: So3) {
        self.rotations.push((stamp, world_from_camera));
    }

    /// Takes the predicted state for a frame that could not be tracked; `is_held` where the depth camera has
    /// corrected it, or the images say that the camera turns on the spot.
    pub fn coast(&mut self, stamp: Stamp, anchored: &AnchoredPose, predicted: NavEstimate, is_held: bool) {
        let at_rest = self.is_at_rest(stamp, &predicted);
        let since = self.last.as_ref().map_or(0.0, |last| stamp - last.stamp);
        self.carried_s += if at_rest || is_held { 0.0 } else { since };
        let tracked = self.last.as_ref().map_or(stamp, |last| last.tracked);
        self.last = Some(Last { stamp, estimate: predicted, anchored: *anchored, tracked });
    }

    /// How well it is known that the camera does not move, m/s: by the readings, else by its images.
    pub fn still_sigma(&self, stamp: Stamp, spot: PureRotation) -> Option<f64> {
        match spot {
            _ if self.is_stationary(stamp) => Some(ZERO_VELOCITY_SIGMA_M_S),
            PureRotation::New => Some(ON_THE_SPOT_SIGMA_M_S),
            PureRotation::Holds => Some(ON_THE_SPOT_BEFORE_SIGMA_M_S),
            PureRotation::No => None,
        }
    }

    /// Since when the readings alone have led to the pose of the last frame; `None` where that was tracked.
    pub fn carried_since(&self) -> Option<Stamp> {
        self.last.as_ref().filter(|last| last.tracked < last.stamp).map(|last| last.tracked)
    }

    /// The IMU data of a frame that becomes a key frame; the next segment starts here.
    pub fn take_segment(&mut self, stamp: Stamp) -> ImuSegment {
        let since = self.requested.replace(stamp);
        let turns = std::mem::take(&mut self.rotations);
        let segment = ImuSegment { turns, ..self.segment_since(since, stamp) };
        self.trust.told();
        segment
    }

    /// The IMU data of a frame, with the readings since `from`.
    pub fn segment_since(&self, from: Option<Stamp>, stamp: Stamp) -> ImuSegment {
        let from = from.filter(|from| self.trust.is_sound_since(*from));
        let samples = from.and_then(|from| self.buffer.between(from, stamp).ok()).unwrap_or_default();
        let state = match &self.last {
            Some(last) if last.stamp == stamp => Some(last.estimate.clone()),
            _ => self.predict(stamp),
        };
        let velocity = state
            .as_ref()
            .map_or_else(Default::default, |b| b.world_from_camera.rotation.inverse() * b.velocity);
        ImuSegment {
            velocity,
            bias: state.map_or(self.bias, |b| b.bias),
            still_sigma: None,
            up: self.up(stamp),
            samples,
            unsound_since: self.trust.unsound_since(),
            offset_s: self.offset_s,
            turns: Vec::new(),
        }
    }

    /// Seconds since the last key frame request; `None` where there are no recent readings.
    pub fn seconds_since_request(&self, stamp: Stamp) -> Option<f64> {
        let fresh = self.buffer.samples().next_back().is_some_and(|s| stamp - s.stamp < SILENT_S);
        self.requested.filter(|_| fresh && self.trust.fault().is_none()).map(|since| stamp - since)
    }

    /// A map was created with this key frame: the readings of the next request start there.
    pub fn map_created(&mut self, k: &KeyFrame) {
        self.requested = Some(k.stamp);
        self.last = None;
        self.version = 0;
    }

    fn carried(&self, from: &NavEstimate, since: Stamp, to: Stamp) -> Option<NavEstimate> {
        from.after(&self.sum(from.bias, since, to)?, &self.imu_from_camera)
    }

    /// The readings between two instants, where they are believed.
    fn sum(&self, bias: Bias, from: Stamp, to: Stamp) -> Option<Preintegrated> {
        if !self.trust.is_sound_since(from) {
            return None;
        }
        self.buffer.preintegrate(bias, from, to).ok()
    }

    /// A state in a map that mapping has aligned with gravity.
    fn state(&self, world_from_camera: Se3, velocity: Vec3, bias: Bias, sigmas: [f64; 5]) -> NavEstimate {
        NavEstimate::new(world_from_camera, velocity, bias, sigmas, &LEVELLED, &self.imu_from_camera)
    }

    /// The up direction in the camera frame, by the mean specific force of the last [`MEAN_FORCE_S`].
    fn up(&self, stamp: Stamp) -> Option<Vec3> {
        if self.trust.fault().is_some() {
            return None;
        }
        let recent = self.buffer.within(stamp.plus_seconds(-MEAN_FORCE_S), stamp);
        let force = recent.map(|s| s.accel).sum::<Vec3>();
        Some(self.imu_from_camera.rotation.inverse() * force.try_normalize(1e-6)?)
    }

    /// The camera's angular velocity at an instant, in the camera frame, rad/s; `None` without readings about it.
    pub fn turning(&self, stamp: Stamp) -> Option<Vec3> {
        if self.trust.fault().is_some() {
            return None;
        }
        let half_s = 0.5 * TURNING_S;
        let about = self.buffer.within(stamp.plus_seconds(-half_s), stamp.plus_seconds(half_s));
        let (mut sum, mut count) = (Vec3::zeros(), 0.0);
        about.for_each(|s| (sum, count) = (sum + s.gyro, count + 1.0));
        let rate = (count > 0.0).then(|| sum / count - self.bias.gyro)?;
        Some(self.imu_from_camera.rotation.inverse() * rate)
    }

    fn is_at_rest(&self, stamp: Stamp, estimate: &NavEstimate) -> bool {
        if estimate.velocity.norm() > self.standing_m_s || self.trust.fault().is_some() {
            return false;
        }
        let config = RestConfig::default();
        let from = stamp.plus_seconds(-1.1 * config.seconds);
        let samples: Vec<ImuSample> = self.buffer.within(from, stamp).copied().collect();
        Rest::of(&samples, &self.noise, Some(&estimate.bias), &config).is_still()
            && !self.starts_moving(stamp, estimate)
    }

    /// Whether the last readings push the camera away: their mean is not the force that holds it against gravity. The noise that
    /// is allowed for at rest hides a walker who sets out gently, and his speed would be held at zero for his first steps.
    fn starts_moving(&self, stamp: Stamp, estimate: &NavEstimate) -> bool {
        let world_from_imu = estimate.world_from_camera.rotation * self.imu_from_camera.rotation.inverse();
        let at_rest = world_from_imu.inverse() * -estimate.gravity.vector() + estimate.bias.accel;
        let (mut off, mut count) = (Vec3::zeros(), 0.0);
        let last = self.buffer.within(stamp.plus_seconds(-STARTS_MOVING.0), stamp);
        last.for_each(|s| (off, count) = (off + s.accel - at_rest, count + 1.0));
        count > 0.0 && off.norm() > STARTS_MOVING.1 * count
    }
}

/// Covariance of a tracked pose.
fn pose_covariance() -> SMatrix<f64, 6, 6> {
    SMatrix::from_fn(|i, j| if i == j { TRACKED_SIGMAS[i / 3].powi(2) } else { 0.0 })
}
