//! The IMU factors of a window: links between its key frames, and priors on biases where links begin.

use crate::subproblem::Subproblem;
use cairn_atlas::{KeyFrame, KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Vec3};
use cairn_inertial::{
    Bias, BiasPrior, Gravity, ImuFactors, ImuLink, MotionFreedom, Preintegrated, SpeedAndBias, ZeroVelocity,
    of_data_sheet,
};
use cairn_sensor::ImuNoise;
use cairn_solve::Freedom;
use std::collections::{BTreeMap, BTreeSet};

/// Standard deviations of the biases before a window, as earlier windows have estimated them: rad/s, m/s^2.
const BIAS_BEFORE: [f64; 2] = [0.002, 0.05];
/// Standard deviations of the biases of any IMU around zero: rad/s, m/s^2.
const BIAS_AT_ALL: [f64; 2] = [0.1, 0.3];

/// Squared whitened residual of a link, of fifteen degrees of freedom, from which on its readings are not those of the motion: with the
/// data sheet's noise five times, that of an accelerometer that is dead for a quarter of a second is above a hundred thousand, and that of
/// a gyroscope that is 1 % of 1 rad/s off for so long is below 100.
const MOST_CHI2: f64 = 300.0;

/// The IMU on the rig.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuModel {
    /// Pose of the camera on the IMU, metres.
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

/// The factors of a subproblem of which poses and motions are free as given.
pub fn factors(
    snapshot: &Snapshot,
    model: &ImuModel,
    subproblem: &Subproblem,
    poses: &[Freedom],
    motions: &[MotionFreedom],
) -> ImuFactors {
    let slots: BTreeMap<KeyFrameId, usize> =
        subproblem.key_frames.iter().enumerate().map(|(slot, id)| (*id, slot)).collect();
    // A link is left out between two key frames that do not move, and at one that moves but whose motion is unknown.
    let known = |slot: usize| poses[slot] == Freedom::Fixed || motions[slot] != MotionFreedom::Fixed;
    let counts = |a: usize, b: usize| known(a) && known(b) && a.min(b) < subproblem.moving;
    let mut imu = ImuFactors::new(model.imu_from_camera, Gravity::level(), Vec::new());
    for (to, (id, freedom)) in subproblem.key_frames.iter().zip(motions).enumerate() {
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
    imu.zero_velocities = zero_velocities(snapshot, subproblem, &imu);
    imu
}

/// Leaves out the links whose readings lead elsewhere than the observations of both ends, after a solve; true where there are some.
/// An IMU whose readings were wrong for a moment is found out by vision some moments later, when they are links already.
pub fn leave_out_contradicted(imu: &mut ImuFactors, poses: &[Se3]) -> bool {
    let chi2 = imu.link_chi2(poses);
    let mut sound = chi2.iter().map(|chi2| *chi2 <= MOST_CHI2);
    let before = imu.links.len();
    imu.links.retain(|_| sound.next().unwrap_or(true));
    imu.bias_priors = bias_priors(imu);
    imu.links.len() < before
}

/// Whether one camera made two key frames.
fn is_of_one_rig(snapshot: &Snapshot, k: &KeyFrame, other: KeyFrameId) -> bool {
    snapshot.key_frame(other).is_some_and(|other| other.other_camera == k.other_camera)
}

/// Key frames of links at which the camera is known not to move. Without that, a chain of links that sees no landmarks ends where
/// the integrated errors of the accelerometer lead: metres away after a turn of some seconds.
fn zero_velocities(snapshot: &Snapshot, subproblem: &Subproblem, imu: &ImuFactors) -> Vec<ZeroVelocity> {
    let linked: BTreeSet<usize> = imu.links.iter().flat_map(|l| [l.from, l.to]).collect();
    let free = linked.into_iter().filter(|slot| imu.motions[*slot].freedom == MotionFreedom::Free);
    let still = |frame: usize| {
        let motion = snapshot.key_frame(subproblem.key_frames[frame])?.motion.as_ref()?;
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
