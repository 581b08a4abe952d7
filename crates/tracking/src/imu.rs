//! Tracking's share of the inertial sensor: the readings of the last seconds, and what they say of the eye between frames.
//!
//! While the world is not level only the readings are kept, for mapping. In a level world there is a [`NavEstimate`]: it begins
//! at the newest key frame that mapping has adjusted with its links, is carried to each frame by what was felt, and
//! narrowed by what is seen there.

use crate::state::AnchoredPose;
use cairn_atlas::{ImuSegment, KeyFrame, Snapshot};
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{Bias, Gravity, ImuBuffer, NavEstimate, Rest, RestConfig};
use cairn_sensor::{ImuNoise, ImuSample, ImuSensor, Stamp};
use nalgebra::SMatrix;

/// Seconds for which the clocks are looked at.
const CLOCKS_S: f64 = 16.0;
/// Directions kept between two offers.
const TURNS: usize = 400;
/// Seconds of readings that are kept.
const KEPT_S: f64 = 20.0;
/// What a key frame's state is uncertain by after its adjustment: metres, radians, m/s, rad/s, m/s^2.
const SETTLED: [f64; 5] = [0.003, 0.002, 0.02, 0.001, 0.05];
/// Landmarks that a key frame shows at least where its adjustment has settled more than what was felt.
const SETTLING: usize = 30;
/// The same where only the pose was seen.
const SEEN: [f64; 5] = [0.005, 0.003, 1.0, 0.003, 0.05];
/// A key frame tells the motion for so many seconds.
const TOLD_S: f64 = 2.0;
/// Standard deviation of the velocity of what stands still, m/s.
const REST_M_S: f64 = 0.003;
/// A sensor that tells nothing for so long is not there, seconds.
const SILENT_S: f64 = 1.0;
/// Seconds over which the mean force tells up.
const FORCE_S: f64 = 0.5;
/// The eye stands still when it is believed to go at most as fast as this, m/s.
const STILL_M_S: f64 = 0.15;

/// What is believed of the last frame.
#[derive(Debug)]
struct Last {
    stamp: Stamp,
    belief: NavEstimate,
    anchored: AnchoredPose,
}

/// Readings and belief.
#[derive(Debug)]
pub(crate) struct InertialFilter {
    buffer: ImuBuffer,
    noise: ImuNoise,
    pub imu_from_camera: Se3,
    last: Option<Last>,
    /// The version of the map that the belief has heard of.
    version: u64,
    /// Since when readings go with the next offer.
    submitted: Option<Stamp>,
    bias: Bias,
    /// What was added to the stamps of the readings.
    offset_s: f64,
    /// Seconds for which the pose was carried in motion since it was last seen.
    carried_s: f64,
    /// When the first direction was seen.
    map_created: Option<Stamp>,
    /// Directions seen since the last offer.
    turns: Vec<(Stamp, So3)>,
}

impl InertialFilter {
    /// `imu_from_camera` in metres.
    pub fn new(sensor: &ImuSensor, imu_from_camera: Se3, noise_times: f64) -> Self {
        let noise = sensor.noise.times([noise_times; 2]);
        Self {
            buffer: ImuBuffer::in_stream(&ImuSensor { noise, ..*sensor }),
            noise: sensor.noise,
            imu_from_camera,
            last: None,
            version: 0,
            submitted: None,
            bias: Bias::default(),
            offset_s: 0.0,
            carried_s: 0.0,
            map_created: None,
            turns: Vec::new(),
        }
    }

    /// Takes the readings of a packet.
    pub fn take(&mut self, samples: &[ImuSample], snapshot: &Snapshot) {
        let offset = snapshot.imu_offset();
        if offset != self.offset_s {
            self.buffer.shift(offset - self.offset_s);
            self.offset_s = offset;
        }
        if offset == 0.0 {
            self.buffer.push(samples);
        } else {
            // What the source made up up to the image is of no use in another clock.
            let real = samples.iter().filter(|s| !s.is_synthesised());
            let shifted = real.map(|s| ImuSample { stamp: s.stamp.plus_seconds(offset), ..*s });
            self.buffer.push(&shifted.collect::<Vec<_>>());
        }
        if let Some(last) = samples.last() {
            self.buffer.forget_before(Stamp(last.stamp.0 - (KEPT_S * 1e9) as i64));
        }
    }

    /// Takes up what has become of the map: the belief goes along with the key frame it hangs on, and where mapping has
    /// adjusted a newer one, it begins there anew.
    pub fn refresh(&mut self, snapshot: &Snapshot) {
        if snapshot.version() == self.version {
            return;
        }
        self.version = snapshot.version();
        if let Some(last) = &mut self.last
            && let Some(standing) =
                snapshot.resolve(last.anchored.reference, &last.anchored.reference_from_camera)
        {
            last.anchored.world_from_camera = standing;
            last.belief.carry_to(standing);
        }
        let newest = snapshot.newest_key_frame().filter(|k| snapshot.is_gravity_aligned(k.map));
        let newest = newest.filter(|k| k.landmarks.iter().flatten().count() >= SETTLING);
        let Some((k, motion)) = newest.and_then(|k| Some((k, k.motion.as_ref()?))) else { return };
        self.bias = motion.bias;
        let told = NavEstimate::new(
            k.world_from_camera,
            k.world_from_camera.rotation * motion.velocity,
            motion.bias,
            SETTLED,
        );
        match &self.last {
            Some(last) if last.stamp > k.frame.stamp => {
                let here = snapshot.key_frame(last.anchored.reference).map(|r| r.map);
                if last.stamp - k.frame.stamp > TOLD_S || here != Some(k.map) {
                    return;
                }
                let Some(carried) = self.carried(&told, k.frame.stamp, last.stamp) else { return };
                let seen = carried.seen(&last.anchored.world_from_camera, &pose_covariance());
                let (stamp, anchored) = (last.stamp, last.anchored);
                self.last = seen.map(|belief| Last { stamp, belief, anchored }).or(self.last.take());
            }
            Some(last) if last.stamp < k.frame.stamp => {}
            _ => {
                let anchored = AnchoredPose::at(k.id, k.world_from_camera);
                self.last = Some(Last { stamp: k.frame.stamp, belief: told, anchored });
            }
        }
    }

    /// What is believed at an instant from the readings alone; `None` where the world is not level or readings are missing.
    pub fn predict(&self, stamp: Stamp) -> Option<NavEstimate> {
        let last = self.last.as_ref()?;
        let carried = self.carried(&last.belief, last.stamp, stamp)?;
        if !self.rests(stamp, &carried) {
            return Some(carried);
        }
        carried.at_rest(REST_M_S)
    }

    /// Seconds for which the pose was carried in motion since it was last seen.
    pub fn carried_s(&self, stamp: Stamp) -> f64 {
        self.carried_s + self.last.as_ref().map_or(0.0, |last| stamp - last.stamp)
    }

    /// Whether the eye stands still, as it is felt and believed.
    pub fn stands(&self, stamp: Stamp) -> bool {
        self.last.as_ref().is_some_and(|last| last.stamp == stamp && self.rests(stamp, &last.belief))
    }

    /// The frame was seen from here with this information over its pose; `predicted` is what was believed before.
    pub fn seen(
        &mut self,
        snapshot: &Snapshot,
        stamp: Stamp,
        anchored: &AnchoredPose,
        predicted: Option<&NavEstimate>,
        information: &SMatrix<f64, 6, 6>,
    ) {
        let covariance = information.try_inverse();
        let seen = predicted.zip(covariance).and_then(|(p, c)| p.seen(&anchored.world_from_camera, &c));
        let level =
            snapshot.key_frame(anchored.reference).is_some_and(|k| snapshot.is_gravity_aligned(k.map));
        let belief = match (seen, &self.last) {
            (Some(seen), _) => seen,
            // Seen again after a gap: how it moves is not known.
            (None, Some(last)) => {
                let turn =
                    anchored.world_from_camera.rotation * last.anchored.world_from_camera.rotation.inverse();
                NavEstimate::new(anchored.world_from_camera, turn * last.belief.velocity, self.bias, SEEN)
            }
            (None, None) => NavEstimate::new(anchored.world_from_camera, Default::default(), self.bias, SEEN),
        };
        self.carried_s = 0.0;
        self.last = level.then_some(Last { stamp, belief, anchored: *anchored });
    }

    /// Whether directions that were seen by the eye alone are still wanted: until the clocks are known.
    pub fn wants_turns(&mut self, stamp: Stamp) -> bool {
        stamp - *self.map_created.get_or_insert(stamp) < CLOCKS_S && self.turns.len() < TURNS
    }

    /// The eye alone saw that it looked this way.
    pub fn turned(&mut self, stamp: Stamp, world_from_camera: So3) {
        self.turns.push((stamp, world_from_camera));
    }

    /// The frame was not seen from anywhere: what was predicted stands.
    pub fn coast(&mut self, stamp: Stamp, anchored: &AnchoredPose, predicted: NavEstimate) {
        let rests = self.rests(stamp, &predicted);
        let since = self.last.as_ref().map_or(0.0, |last| stamp - last.stamp);
        self.carried_s += if rests { 0.0 } else { since };
        self.last = Some(Last { stamp, belief: predicted, anchored: *anchored });
    }

    /// What goes with an offered frame, and from it on with the next.
    pub fn sense(&mut self, stamp: Stamp) -> ImuSegment {
        let since = self.submitted.replace(stamp);
        let turns = std::mem::take(&mut self.turns);
        ImuSegment { turns, ..self.segment_since(since, stamp) }
    }

    /// The same for a frame at which another begins to be felt since `from`.
    pub fn segment_since(&self, from: Option<Stamp>, stamp: Stamp) -> ImuSegment {
        let samples = from.and_then(|from| self.buffer.between(from, stamp).ok()).unwrap_or_default();
        let here = match &self.last {
            Some(last) if last.stamp == stamp => Some(last.belief.clone()),
            _ => self.predict(stamp),
        };
        let velocity = here
            .as_ref()
            .map_or_else(Default::default, |b| b.world_from_camera.rotation.inverse() * b.velocity);
        ImuSegment {
            velocity,
            bias: here.map_or(self.bias, |b| b.bias),
            up: self.up(stamp),
            samples,
            offset_s: self.offset_s,
            turns: Vec::new(),
        }
    }

    /// Seconds since a frame was last offered; `None` where nothing is felt.
    pub fn unoffered(&self, stamp: Stamp) -> Option<f64> {
        let fresh = self.buffer.samples().next_back().is_some_and(|s| stamp - s.stamp < SILENT_S);
        self.submitted.filter(|_| fresh).map(|since| stamp - since)
    }

    /// A world has begun with a key frame: readings go with offers from there on.
    pub fn map_created(&mut self, k: &KeyFrame) {
        self.submitted = Some(k.frame.stamp);
        self.last = None;
        self.version = 0;
    }

    fn carried(&self, from: &NavEstimate, since: Stamp, to: Stamp) -> Option<NavEstimate> {
        let sum = self.buffer.preintegrate(from.bias, since, to).ok()?;
        from.after(&sum, &Gravity::level(), &self.imu_from_camera)
    }

    /// Up along the eye's axes by the mean force of the last while.
    fn up(&self, stamp: Stamp) -> Option<Vec3> {
        let late = self.buffer.within(stamp.plus_seconds(-FORCE_S), stamp);
        let force = late.map(|s| s.accel).sum::<Vec3>();
        Some(self.imu_from_camera.rotation.inverse() * force.try_normalize(1e-6)?)
    }

    fn rests(&self, stamp: Stamp, believed: &NavEstimate) -> bool {
        if believed.velocity.norm() > STILL_M_S {
            return false;
        }
        let config = RestConfig::default();
        let from = stamp.plus_seconds(-1.1 * config.seconds);
        let samples: Vec<ImuSample> = self.buffer.within(from, stamp).copied().collect();
        Rest::of(&samples, &self.noise, Some(&believed.bias), &config).is_still()
    }
}

/// Of a pose that was seen.
fn pose_covariance() -> SMatrix<f64, 6, 6> {
    SMatrix::from_fn(|i, j| if i == j { SEEN[i / 3].powi(2) } else { 0.0 })
}
