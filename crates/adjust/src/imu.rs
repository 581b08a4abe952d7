//! The readings of an IMU as factors of a window of a gravity-aligned map: links between its key frames, and priors on biases where links
//! begin. Around a key frame the last ones up to it move, one linked to the next; that before them keeps its pose and velocity.

use crate::factor::{Chain, Frames, Judgement, WindowFactors};
use cairn_atlas::{Change, KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::{
    Bias, BiasPrior, Gravity, ImuFactors, ImuLink, LeverArm, MotionFreedom, Preintegrated, SpeedAndBias,
    ZeroVelocity, of_data_sheet,
};
use cairn_sensor::ImuNoise;
use cairn_solve::{Equations, Factors, Freedom, Variable};
use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;

/// Standard deviations of the biases before a window, as earlier windows have estimated them: rad/s, m/s^2.
const BIAS_BEFORE: [f64; 2] = [0.002, 0.05];
/// Standard deviations of the biases of any IMU around zero: rad/s, m/s^2.
const BIAS_AT_ALL: [f64; 2] = [0.1, 0.3];

/// Squared whitened residual of a link, of fifteen degrees of freedom, from which on its readings are not those of the motion: with
/// five times the noise of the data sheet that of an accelerometer that is dead for a quarter of a second was above a hundred thousand, and
/// that of a gyroscope that is 1 % of 1 rad/s off for so long below 100. With twice the noise both are 6.25 times as large.
const MOST_CHI2: f64 = 1000.0;

/// The IMU on the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuModel {
    /// Pose of the camera on the IMU by what is stated of the rig, metres; a map may know it better.
    pub imu_from_camera: Se3,
    /// Its noise as it is in this motion, often several times that of its data sheet.
    pub noise: ImuNoise,
    /// Of IMUs of other rigs, whose factors state their noise: by what their white noise is multiplied.
    pub others_times: f64,
}

impl ImuModel {
    /// The IMU of the rig that made a key frame, with the noise of its factors; `None` where it is not known how it is mounted.
    fn of(&self, k: &KeyFrame) -> Option<Self> {
        let Some(other) = &k.other_camera else { return Some(*self) };
        let stated = k.motion.as_ref().and_then(|m| m.imu_factor.as_ref()).map(|f| f.sum.noise());
        let noise = stated.map_or(self.noise, |n| of_data_sheet(n).times([self.others_times; 2]));
        Some(Self { imu_from_camera: other.imu_from_camera?, noise, ..*self })
    }
}

/// The key frame from which another's readings were preintegrated.
pub fn before(k: &KeyFrame) -> Option<KeyFrameId> {
    Some(k.motion.as_ref()?.imu_factor.as_ref()?.since)
}

/// The key frames of a map with a motion that is linked to that of another one.
pub fn linked(snapshot: &Snapshot, map: MapId) -> BTreeSet<KeyFrameId> {
    let mut linked = BTreeSet::new();
    for k in snapshot.key_frames_of(map) {
        if let Some(earlier) = before(k) {
            linked.extend([k.id, earlier]);
        }
    }
    linked.retain(|id| snapshot.key_frame(*id).is_some_and(|k| k.motion.is_some()));
    linked
}

/// The readings of an IMU.
#[derive(Clone, Debug)]
pub struct Imu {
    model: ImuModel,
    /// How many key frames of a chain move.
    chain: usize,
    /// Standard deviation of where the rig says that the camera is on the IMU, metres; 0: that is as the map has it.
    lever_arm_sigma: f64,
    factors: ImuFactors,
    /// Velocities and biases before a solve.
    motions_before: Vec<SpeedAndBias>,
}

impl Imu {
    /// In windows around a key frame all move that are linked to it, one to the next.
    pub fn new(model: ImuModel) -> Self {
        let factors = ImuFactors::new(model.imu_from_camera, Gravity::level(), Vec::new());
        Self { model, chain: usize::MAX, lever_arm_sigma: 0.0, factors, motions_before: Vec::new() }
    }

    /// Of them the last so many.
    pub fn with_chain(self, chain: usize) -> Self {
        Self { chain, ..self }
    }

    /// Where the camera is on the IMU is solved for, about what the model says, with this standard deviation, metres; 0: it is not.
    pub fn with_lever_arm(self, lever_arm_sigma: f64) -> Self {
        Self { lever_arm_sigma, ..self }
    }

    /// What is solved for of each key frame's motion.
    fn freedom(&self, snapshot: &Snapshot, frames: &Frames) -> Vec<MotionFreedom> {
        let linked = frames.centre.is_none().then(|| linked(snapshot, frames.map));
        let before = frames.centre.and_then(|centre| self.chain(snapshot, centre)?.before);
        let of = |(slot, id): (usize, &KeyFrameId)| {
            let is_known = snapshot.key_frame(*id).is_some_and(|k| k.motion.is_some());
            match &linked {
                Some(linked) if linked.contains(id) => MotionFreedom::Free,
                Some(_) => MotionFreedom::Fixed,
                // Its biases may still change.
                None if is_known && Some(*id) == before => MotionFreedom::Biases,
                None if slot >= frames.moving => MotionFreedom::Fixed,
                None if is_known || *id == frames.map.root() => MotionFreedom::Free,
                None => MotionFreedom::Fixed,
            }
        };
        frames.key_frames.iter().enumerate().map(of).collect()
    }
}

impl WindowFactors for Imu {
    fn chain(&self, snapshot: &Snapshot, centre: KeyFrameId) -> Option<Chain> {
        let (mut moving, mut next) = (Vec::new(), Some(centre));
        while let Some(id) = next.filter(|_| moving.len() < self.chain) {
            moving.push(id);
            next = before(snapshot.key_frame(id)?);
        }
        let is_known = next.is_none_or(|id| snapshot.key_frame(id).is_some());
        is_known.then_some(Chain { moving, before: next })
    }
    /// The key frame before the chain bounds velocity and biases, whether it observes the same landmarks or not. The root of a whole map
    /// keeps its position and heading.
    fn choose(&mut self, snapshot: &Snapshot, frames: &mut Frames) {
        match frames.centre {
            Some(centre) => {
                let before = self.chain(snapshot, centre).and_then(|chain| chain.before);
                before.into_iter().for_each(|id| frames.hold(snapshot, id));
            }
            None => {
                let root = frames.slot(frames.map.root());
                root.into_iter().for_each(|root| frames.freedom[root] = Freedom::Tilt(Vec3::z()));
            }
        }
        frames.is_anchored = true;
    }
    fn bind(&mut self, snapshot: &Snapshot, frames: &Frames) -> usize {
        self.factors = factors(snapshot, &self.model, frames, &self.freedom(snapshot, frames));
        let (stated, sigma) = (self.model.imu_from_camera.translation, self.lever_arm_sigma);
        self.factors.lever_arm = (sigma > 0.0).then_some(LeverArm { stated, sigma });
        self.motions_before.clone_from(&self.factors.motions);
        self.factors.links.len()
    }
    /// With links even scale may be weakly determined: the first step is damped less.
    fn first_damping(&self) -> f64 {
        1e-6
    }
    /// Readings are a witness, not the judge: an IMU whose readings were wrong for a moment is found out by vision some moments later, when
    /// they are links already. Those that lead elsewhere than the observations of both ends are left out.
    fn judge(&mut self, _: &[Se3], after: &[Se3]) -> Judgement {
        let chi2 = self.factors.link_chi2(after);
        let mut sound = chi2.iter().map(|chi2| *chi2 <= MOST_CHI2);
        self.factors.links.retain(|_| sound.next().unwrap_or(true));
        self.factors.bias_priors = bias_priors(&self.factors);
        if self.factors.links.len() == chi2.len() {
            return Judgement::Agrees;
        }
        self.factors.motions.clone_from(&self.motions_before);
        Judgement::LeftOut
    }
    fn changes(&self, frames: &Frames, poses: &[Se3]) -> Vec<Change> {
        let moving = frames.key_frames[..frames.moving].iter().zip(&self.factors.motions).zip(poses);
        let free = moving.filter(|((_, motion), _)| motion.freedom == MotionFreedom::Free);
        let change = |((id, motion), pose): ((&KeyFrameId, &SpeedAndBias), &Se3)| {
            Change::InertialState(*id, pose.rotation.inverse() * motion.velocity, motion.bias)
        };
        let arm = self.factors.lever_arm.map(|_| Change::LeverArm(self.factors.imu_from_camera.translation));
        free.map(change).chain(arm).collect()
    }
}

impl Factors for Imu {
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.factors.scopes(visit);
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        self.factors.linearise(poses, equations)
    }
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        self.factors.attempt(poses, step)
    }
    fn accept(&mut self) {
        self.factors.accept();
    }
    fn sizes(&self) -> Vec<usize> {
        self.factors.sizes()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        self.factors.held()
    }
}

/// The factors between key frames of which poses and motions are free as given.
fn factors(snapshot: &Snapshot, model: &ImuModel, frames: &Frames, motions: &[MotionFreedom]) -> ImuFactors {
    let slots: BTreeMap<KeyFrameId, usize> =
        frames.key_frames.iter().enumerate().map(|(slot, id)| (*id, slot)).collect();
    // A link is left out between two key frames that do not move, and at one that moves but whose motion is unknown.
    let known = |slot: usize| frames.freedom[slot] == Freedom::Fixed || motions[slot] != MotionFreedom::Fixed;
    let counts = |a: usize, b: usize| known(a) && known(b) && a.min(b) < frames.moving;
    let mount = snapshot.imu_from_camera().unwrap_or(&model.imu_from_camera);
    let mut imu = ImuFactors::new(*mount, Gravity::level(), Vec::new());
    for (to, (id, freedom)) in frames.key_frames.iter().zip(motions).enumerate() {
        let mut state = SpeedAndBias { velocity: Vec3::zeros(), bias: Bias::default(), freedom: *freedom };
        if let Some((k, motion)) = snapshot.key_frame(*id).and_then(|k| Some((k, k.motion.as_ref()?))) {
            (state.velocity, state.bias) = (k.world_from_camera.rotation * motion.velocity, motion.bias);
            let factor = motion.imu_factor.as_ref();
            let linked = factor.and_then(|f| Some((f, *slots.get(&f.since)?)));
            let linked = linked.filter(|(f, from)| counts(*from, to) && is_of_one_rig(snapshot, k, f.since));
            if let Some(((factor, from), of)) = linked.zip(model.of(k)) {
                let sum = Preintegrated::of(of.noise, motion.bias, factor.sum.samples().to_vec());
                imu.links.push(ImuLink { from, to, sum });
            }
            let other = k.other_camera.as_ref().and_then(|other| other.imu_from_camera);
            imu.other_mounts.extend(other.map(|mount| (to, mount)));
        }
        imu.motions.push(state);
    }
    imu.bias_priors = bias_priors(&imu);
    imu.zero_velocities = zero_velocities(snapshot, frames, &imu);
    imu
}

/// Whether one camera made two key frames.
fn is_of_one_rig(snapshot: &Snapshot, k: &KeyFrame, other: KeyFrameId) -> bool {
    snapshot.key_frame(other).is_some_and(|other| other.other_camera == k.other_camera)
}

/// Key frames of links at which the camera is known not to move. Without that, a chain of links that sees no landmarks ends where
/// the integrated errors of the accelerometer lead: metres away after a turn of some seconds.
fn zero_velocities(snapshot: &Snapshot, frames: &Frames, imu: &ImuFactors) -> Vec<ZeroVelocity> {
    let linked: BTreeSet<usize> = imu.links.iter().flat_map(|l| [l.from, l.to]).collect();
    let free = linked.into_iter().filter(|slot| imu.motions[*slot].freedom == MotionFreedom::Free);
    let still = |frame: usize| {
        let motion = snapshot.key_frame(frames.key_frames[frame])?.motion.as_ref()?;
        Some(ZeroVelocity { frame, sigma: motion.still_sigma? })
    };
    free.filter_map(still).collect()
}

/// Priors on the biases where chains of links begin.
fn bias_priors(imu: &ImuFactors) -> Vec<BiasPrior> {
    let ends: BTreeSet<usize> = imu.links.iter().map(|l| l.to).collect();
    let begins: BTreeSet<usize> =
        imu.links.iter().map(|l| l.from).filter(|slot| !ends.contains(slot)).collect();
    let prior = |frame: usize| match imu.motions[frame].freedom {
        MotionFreedom::Biases => BiasPrior { frame, bias: imu.motions[frame].bias, sigmas: BIAS_BEFORE },
        _ => BiasPrior { frame, bias: Bias::default(), sigmas: BIAS_AT_ALL },
    };
    begins.into_iter().map(prior).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bias_priors_stand_where_chains_of_links_begin() {
        let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-4, accel: 1e-2, accel_walk: 1e-3 };
        let bias = Bias { gyro: Vec3::x() * 0.01, accel: Vec3::y() * 0.1 };
        let motion = |freedom| SpeedAndBias { velocity: Vec3::zeros(), bias, freedom };
        let motions = [MotionFreedom::Biases, MotionFreedom::Free, MotionFreedom::Free, MotionFreedom::Free];
        let mut imu = ImuFactors::new(Se3::identity(), Gravity::level(), motions.map(motion).to_vec());
        let sum = Preintegrated::of(noise, bias, Vec::new());
        let link = |from, to| ImuLink { from, to, sum: sum.clone() };
        // One chain goes on from a key frame whose velocity stays, another begins at one that is free.
        imu.links = vec![link(0, 1), link(2, 3)];
        let priors = bias_priors(&imu);
        let expected = [
            BiasPrior { frame: 0, bias, sigmas: BIAS_BEFORE },
            BiasPrior { frame: 2, bias: Bias::default(), sigmas: BIAS_AT_ALL },
        ];
        assert_eq!(priors, expected);
        imu.links.push(link(1, 2));
        assert_eq!(bias_priors(&imu), expected[..1]);
    }
}
