//! Whether the readings of the IMU are believed: each by itself, and what they lead to by what vision saw.
//!
//! In: the readings as they come, and the pose of each frame as vision alone has it. Out: which readings may be used. A fault cuts out
//! all readings from its beginning on: nothing is predicted by them, no key frames are linked by them, nothing coasts on them. They are
//! taken up again, from there on, once they have led for a while where vision went.
//!
//! Vision decides because it is the better witness here: what it sees it sees again, while a reading that is wrong once stays in velocity
//! and position.

use crate::state::AnchoredPose;
use cairn_atlas::Snapshot;
use cairn_geometry::{Se3, So3, Vec3};
use cairn_inertial::{
    Bias, Difference, Failed, ImuBuffer, ImuFault, Innovation, Known, OffsetConfig, ReadingsCheck,
    innovation, time_offset,
};
use cairn_sensor::{ImuSample, Stamp};
use std::collections::VecDeque;

/// Seconds between the poses that are compared with the readings.
const APART_S: f64 = 0.25;
/// Seconds of poses that are kept: two such distances, and what lies between two frames.
const KEPT_S: f64 = 0.8;
/// By how many standard deviations vision and readings have to differ for a fault.
const DIFFERS: f64 = 6.0;
/// In so many frames in a row: a pose that is wrong once is compared in three that are apart.
const FRAMES: usize = 3;
/// Up to how many they agree.
const AGREES: f64 = 3.5;
/// Up to how many they agree well. Readings since then are in doubt when they differ some moments later.
const AGREES_WELL: f64 = 2.0;
/// A fault goes unnoticed for no longer, seconds.
const MOST_UNNOTICED_S: f64 = 2.0;
/// Seconds of agreement after which readings are used again.
const AGREED_S: f64 = 0.5;
/// By how many standard deviations something has to have been measured for agreement to tell anything: of a camera that rests, and
/// readings of nothing, it does not.
const TELLS: f64 = 3.0;
/// No reading for so long before a frame, seconds.
const SILENT_S: f64 = 0.3;
/// Standard deviations of a pose by vision alone against those around it, metres and radians.
const POSE_SIGMA: [f64; 2] = [0.008, 0.004];
/// Standard deviations of the biases once they were estimated: rad/s, and m/s^2 with the tilt of gravity.
const BIAS_SIGMA: [f64; 2] = [0.01, 0.25];
/// Standard deviation of the gyroscope's bias before that, rad/s.
const UNKNOWN_BIAS: f64 = 0.1;
/// What scale and alignment may be off.
const RELATIVE: f64 = 0.1;

/// Seconds of turns by the images that are compared with those of a gyroscope that may be of another time, and again after so many.
const CLOCKS_S: f64 = 3.0;
/// A clock that has jumped is looked for within so many seconds to either side.
const JUMPED_S: f64 = 0.7;
/// One that has jumped by less is not what is wrong, seconds.
const LEAST_JUMP_S: f64 = 0.003;
/// What turns of images and gyroscope may differ by once they are of one time, radians.
const SAME_TURNS_RAD: f64 = 0.02;

/// A pose that vision gave without the readings.
#[derive(Clone, Copy, Debug)]
struct Seen {
    stamp: Stamp,
    anchored: AnchoredPose,
}

/// Readings that are not believed.
#[derive(Clone, Copy, Debug)]
struct Doubt {
    /// Since when they are not, by the stamp of the first reading.
    since: Stamp,
    fault: ImuFault,
    /// The last reading, or frame, with a fault.
    failing: Stamp,
    /// Seconds of agreement since.
    agreed_s: f64,
}

/// What is known of the IMU's state when vision and readings are compared.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Belief {
    pub bias: Bias,
    /// Free fall in the world, where the map is gravity-aligned and metric.
    pub gravity: Option<Vec3>,
    pub imu_from_camera: Se3,
}

/// Whether readings are believed.
#[derive(Clone, Debug, Default)]
pub(crate) struct ImuTrust {
    check: ReadingsCheck,
    doubt: Option<Doubt>,
    /// Readings from before are not used.
    sound_since: Option<Stamp>,
    /// Readings since then failed, which has not been told with a key frame yet.
    untold: Option<Stamp>,
    seen: VecDeque<Seen>,
    refused: usize,
    /// Frames in a row up to now that differ.
    differing: usize,
    /// The first of the last poses that agreed well with the readings.
    agreed: Option<Stamp>,
    /// Orientations by the images since the readings are in doubt.
    turns: Vec<(Stamp, So3)>,
}

impl ImuTrust {
    /// The clock of the readings is found to be off by so many seconds: those that come are moved, as those before are now.
    pub fn shift(&mut self, seconds: f64) {
        self.check.shift(seconds);
    }

    /// Tests a reading that has come; false where it is left out.
    pub fn take(&mut self, sample: &ImuSample) -> bool {
        match self.check.test(sample) {
            None => true,
            Some(Failed { fault: ImuFault::OutOfRange { .. } | ImuFault::Spike { .. }, .. }) => {
                self.refused += 1;
                false
            }
            Some(failed) => {
                self.fail(failed, sample.stamp);
                true
            }
        }
    }

    /// The readings failed; up to `until`.
    fn fail(&mut self, Failed { fault, since }: Failed, until: Stamp) {
        let since = self.doubt.map_or(since, |doubt| doubt.since.min(since));
        self.untold = Some(self.untold.map_or(since, |untold| untold.min(since)));
        self.doubt = Some(Doubt { since, fault, failing: until, agreed_s: 0.0 });
    }

    /// What is wrong with the readings, and since when; `None` while they are believed.
    pub fn fault(&self) -> Option<Failed> {
        self.doubt.map(|Doubt { fault, since, .. }| Failed { fault, since })
    }

    /// Since when readings have failed that were believed when earlier key frames were asked for.
    pub fn unsound_since(&self) -> Option<Stamp> {
        self.untold
    }

    /// A key frame has been asked for, which tells so.
    pub fn told(&mut self) {
        self.untold = None;
    }

    /// Readings that were left out one by one.
    pub fn refused(&self) -> usize {
        self.refused
    }

    /// Whether the readings from an instant on are believed.
    pub fn is_sound_since(&self, from: Stamp) -> bool {
        self.doubt.is_none() && self.sound_since.is_none_or(|since| from >= since)
    }

    /// Compares the readings with the pose of a frame as vision alone has it. True where they are found wrong that were believed.
    pub fn see(
        &mut self,
        snapshot: &Snapshot,
        stamp: Stamp,
        anchored: &AnchoredPose,
        buffer: &ImuBuffer,
        belief: &Belief,
    ) -> bool {
        while self.seen.front().is_some_and(|s| stamp - s.stamp > KEPT_S || stamp <= s.stamp) {
            self.seen.pop_front();
        }
        self.seen.push_back(Seen { stamp, anchored: *anchored });
        let newest = buffer.samples().next_back().map(|s| s.stamp);
        if let Some(newest) = newest.filter(|newest| stamp - *newest > SILENT_S) {
            let was_believed = self.doubt.is_none();
            self.fail(Failed { fault: ImuFault::Silent { seconds: stamp - newest }, since: newest }, stamp);
            return was_believed;
        }
        let Some((since, told)) = self.compared(snapshot, stamp, buffer, belief) else { return false };
        self.judge(since, stamp, &told)
    }

    /// The innovation of the last poses, and the first of their times.
    fn compared(
        &self,
        snapshot: &Snapshot,
        stamp: Stamp,
        buffer: &ImuBuffer,
        belief: &Belief,
    ) -> Option<(Stamp, Innovation)> {
        let before = |at: Stamp| self.seen.iter().rev().find(|s| at - s.stamp >= APART_S - 0.5e-3);
        let middle = before(stamp)?;
        let first = before(middle.stamp)?;
        let sound_since = self.doubt.map(|d| d.failing).max(self.sound_since);
        if sound_since.is_some_and(|since| first.stamp <= since) {
            return None;
        }
        let last = self.seen.back()?;
        let imu_from_camera = belief.imu_from_camera;
        let pose = |s: &Seen| {
            let camera = snapshot.resolve(s.anchored.reference, &s.anchored.reference_from_camera)?;
            Some(camera * imu_from_camera.inverse())
        };
        let poses = [pose(first)?, pose(middle)?, pose(last)?];
        let sum = |from: &Seen, to: &Seen| buffer.preintegrate(belief.bias, from.stamp, to.stamp).ok();
        let sums = [sum(first, middle)?, sum(middle, last)?];
        let gyro = if belief.gravity.is_some() { BIAS_SIGMA[0] } else { UNKNOWN_BIAS };
        let known = Known {
            bias: belief.bias,
            bias_sigma: [gyro, BIAS_SIGMA[1]],
            gravity: belief.gravity,
            pose_sigma: POSE_SIGMA,
            relative: RELATIVE,
        };
        Some((first.stamp, innovation(&poses, [&sums[0], &sums[1]], &known)))
    }

    /// By how much the clock of the IMU has jumped, where that is what is wrong with it: seconds to be added to its stamps. The gyroscope
    /// then turns as the images do, at another time.
    pub fn clock_jump(
        &mut self,
        stamp: Stamp,
        buffer: &ImuBuffer,
        belief: &Belief,
        camera: So3,
    ) -> Option<f64> {
        let Some(doubt) = &mut self.doubt else {
            self.turns.clear();
            return None;
        };
        self.turns.push((stamp, camera));
        let first = self.turns.first()?.0;
        let may_be = matches!(doubt.fault, ImuFault::TurnsOtherwise { .. } | ImuFault::MovesOtherwise { .. });
        if stamp - first < CLOCKS_S {
            return None;
        }
        let turns = std::mem::take(&mut self.turns);
        if !may_be {
            return None;
        }
        let samples: Vec<ImuSample> = buffer.within(first.plus_seconds(-JUMPED_S), stamp).copied().collect();
        let config = OffsetConfig { most_s: JUMPED_S, rotation_sigma: 0.02, ..OffsetConfig::default() };
        let found = time_offset(&turns, &samples, &belief.imu_from_camera.rotation, &config).ok()?;
        let jumped = found.offset_s.abs() > LEAST_JUMP_S && found.residual < SAME_TURNS_RAD;
        if !jumped {
            return None;
        }
        (doubt.failing, doubt.agreed_s) = (stamp.plus_seconds(found.offset_s).min(stamp), 0.0);
        Some(found.offset_s)
    }

    /// What the innovation of a frame means.
    fn judge(&mut self, since: Stamp, stamp: Stamp, told: &Innovation) -> bool {
        let turn = Some(told.turn);
        let differs = fault_of(turn, told.motion);
        self.differing = if differs.is_some() { self.differing + 1 } else { 0 };
        let was_believed = self.doubt.is_none();
        if let Some(fault) = differs.filter(|_| !was_believed || self.differing >= FRAMES) {
            let agreed = self.agreed.filter(|agreed| was_believed && since - *agreed < MOST_UNNOTICED_S);
            self.fail(Failed { fault, since: agreed.map_or(since, |agreed| agreed.min(since)) }, stamp);
            return was_believed;
        }
        let all = [turn, told.motion].into_iter().flatten();
        let tells = all.clone().any(|d| d.tells(TELLS));
        let agrees_within = |sigmas: f64| all.clone().all(|d| d.normalised() < sigmas);
        if tells && agrees_within(AGREES_WELL) {
            self.agreed = Some(since);
        }
        let agrees = agrees_within(AGREES);
        let before = self.seen.iter().rev().nth(1).map_or(stamp, |s| s.stamp);
        let Some(doubt) = &mut self.doubt else { return false };
        if !agrees {
            doubt.agreed_s = 0.0;
        } else if tells {
            doubt.agreed_s += stamp - before;
        }
        if doubt.agreed_s >= AGREED_S {
            (self.doubt, self.sound_since) = (None, Some(since));
        }
        false
    }
}

fn fault_of(turn: Option<Difference>, motion: Option<Difference>) -> Option<ImuFault> {
    let differs = |d: &Difference| d.normalised() > DIFFERS;
    let turns = turn.filter(differs).map(|d| ImuFault::TurnsOtherwise {
        off_rad: d.off,
        sigma_rad: d.sigma,
        seconds: d.seconds,
    });
    turns.or(motion.filter(differs).map(|d| ImuFault::MovesOtherwise {
        off_m: d.off,
        sigma_m: d.sigma,
        seconds: d.seconds,
    }))
}
