//! IMU factors of a bundle of key frames: velocities and biases as variables, preintegrated readings and bias priors as
//! factors. They are solved by [`Bundle::solve_with`](cairn_solve::Bundle::solve_with).
//!
//! A key frame has its pose in the bundle (the camera, as everywhere in a map) and here a [`SpeedAndBias`] of nine unknowns:
//! velocity, gyro bias, accel bias. A link couples the poses and motions of its two ends. The IMU is one constant
//! transform away from the camera, and Jacobians go through the adjoint of that transform. Its translation, the lever arm, may be three
//! more unknowns, which all links share: a phone does not tell where in it the two are, and one who walks and turns feels 5 cm of it
//! like a step. The world is in metres with gravity as given.
//!
//! Source: visual-inertial bundle adjustment as in Campos et al., "ORB-SLAM3" (TRO 2021), eq. 3-5.

use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Se3, Vec3};
use cairn_solve::{Equations, Factors, Variable};
use nalgebra::{SMatrix, SVector};
use std::collections::BTreeMap;
use std::ops::Range;

/// Unknowns of a motion: velocity, gyro bias, accel bias.
const MOTION: usize = 9;
/// Rows of a link's residual.
const ROWS: usize = 15;
/// Columns of a link's Jacobian: pose and motion of either end, and the lever arm.
const COLUMNS: usize = 33;

/// What of a key frame's motion is solved for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MotionFreedom {
    /// Velocity and biases.
    Free,
    /// The biases; the velocity stays.
    Biases,
    /// Nothing.
    Fixed,
}

/// Velocity and biases at a key frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SpeedAndBias {
    /// Velocity of the IMU in the world, m/s.
    pub velocity: Vec3,
    /// Biases of the IMU.
    pub bias: Bias,
    /// What of it is solved for. A motion that no link or prior touches stays in any case.
    pub freedom: MotionFreedom,
}

impl SpeedAndBias {
    fn moved(&self, d: &[f64]) -> Self {
        let part = |i: usize| Vec3::new(d[i], d[i + 1], d[i + 2]);
        let bias = Bias { gyro: self.bias.gyro + part(3), accel: self.bias.accel + part(6) };
        Self { velocity: self.velocity + part(0), bias, freedom: self.freedom }
    }
}

/// Readings from one key frame of the window to another.
#[derive(Clone, Debug)]
pub struct ImuLink {
    /// Index of the earlier key frame.
    pub from: usize,
    /// Index of the later key frame.
    pub to: usize,
    /// The preintegrated readings between the two stamps.
    pub sum: Preintegrated,
}

/// A prior on a key frame's biases.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BiasPrior {
    /// Index of the key frame.
    pub frame: usize,
    /// The biases.
    pub bias: Bias,
    /// Standard deviations of the gyro and of the accel bias, each axis: rad/s and m/s^2.
    pub sigmas: [f64; 2],
}

impl BiasPrior {
    /// The six whitened residuals, and what whitens each.
    fn residual(&self, of: &Bias) -> (SVector<f64, 6>, SVector<f64, 6>) {
        let (gyro, accel) = (of.gyro - self.bias.gyro, of.accel - self.bias.accel);
        let by = SVector::<f64, 6>::from_fn(|i, _| 1.0 / self.sigmas[i / 3]);
        let off = SVector::<f64, 6>::from_fn(|i, _| if i < 3 { gyro[i] } else { accel[i - 3] });
        (off.component_mul(&by), by)
    }
}

/// A key frame at which the IMU does not move (a zero-velocity update).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroVelocity {
    /// Index of the key frame.
    pub frame: usize,
    /// Standard deviation of each component of the velocity, m/s.
    pub sigma: f64,
}

impl ZeroVelocity {
    fn residual(&self, of: &SpeedAndBias) -> SVector<f64, 3> {
        of.velocity / self.sigma
    }
}

/// What is known of the lever arm before a solve, where it is solved for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeverArm {
    /// Where the camera is on the IMU by what is stated of the rig, metres.
    pub stated: Vec3,
    /// Standard deviation of that, each axis, metres.
    pub sigma: f64,
}

impl LeverArm {
    fn residual(&self, arm: &Vec3) -> SVector<f64, 3> {
        (arm - self.stated) / self.sigma
    }
}

/// IMU factors over the poses of a bundle, and, after its solve, the motions found.
#[derive(Clone, Debug)]
pub struct ImuFactors {
    /// Pose of the camera on the IMU, metres.
    pub imu_from_camera: Se3,
    /// Whether its translation is solved for.
    pub lever_arm: Option<LeverArm>,
    /// The same of key frames that other rigs made, by their index.
    pub other_mounts: BTreeMap<usize, Se3>,
    /// Gravity in the world.
    pub gravity: Gravity,
    /// One for each pose of the bundle.
    pub motions: Vec<SpeedAndBias>,
    /// Preintegrated readings between key frames.
    pub links: Vec<ImuLink>,
    /// Priors on biases.
    pub bias_priors: Vec<BiasPrior>,
    /// Key frames at which it does not move.
    pub zero_velocities: Vec<ZeroVelocity>,
    trial: Vec<SpeedAndBias>,
    trial_arm: Vec3,
}

impl ImuFactors {
    /// Factors over `motions.len()` key frames, of which none is linked yet.
    pub fn new(imu_from_camera: Se3, gravity: Gravity, motions: Vec<SpeedAndBias>) -> Self {
        Self {
            imu_from_camera,
            lever_arm: None,
            trial_arm: imu_from_camera.translation,
            other_mounts: BTreeMap::new(),
            gravity,
            trial: motions.clone(),
            motions,
            links: vec![],
            bias_priors: vec![],
            zero_velocities: vec![],
        }
    }

    /// Squared whitened residual of each link, with fifteen degrees of freedom: one in a hundred exceeds 30.6 by chance.
    /// Infinite for a link without a covariance.
    pub fn link_chi2(&self, poses: &[Se3]) -> Vec<f64> {
        let whitened = |l: &ImuLink| self.whitened(l, poses, &self.motions, self.arm());
        self.links.iter().map(|l| whitened(l).map_or(f64::INFINITY, |r| r.norm_squared())).collect()
    }

    fn arm(&self) -> &Vec3 {
        &self.imu_from_camera.translation
    }

    /// Pose of the camera of a key frame on the IMU.
    fn mount(&self, frame: usize, arm: &Vec3) -> Se3 {
        let own = || Se3::new(self.imu_from_camera.rotation, *arm);
        self.other_mounts.get(&frame).copied().unwrap_or_else(own)
    }

    /// State of the IMU at a key frame.
    fn nav(&self, frame: usize, poses: &[Se3], motions: &[SpeedAndBias], arm: &Vec3) -> NavState {
        let world_from_imu = poses[frame] * self.mount(frame, arm).inverse();
        NavState { world_from_imu, velocity: motions[frame].velocity, bias: motions[frame].bias }
    }

    fn whitened(
        &self,
        link: &ImuLink,
        poses: &[Se3],
        motions: &[SpeedAndBias],
        arm: &Vec3,
    ) -> Option<SVector<f64, ROWS>> {
        let nav = |i: usize| self.nav(i, poses, motions, arm);
        Some(link.sum.whitening()? * link.sum.residual(&nav(link.from), &nav(link.to), &self.gravity))
    }

    fn cost(&self, poses: &[Se3], motions: &[SpeedAndBias], arm: &Vec3) -> f64 {
        let mut cost = self.lever_arm.map_or(0.0, |prior| 0.5 * prior.residual(arm).norm_squared());
        for link in &self.links {
            cost +=
                self.whitened(link, poses, motions, arm).map_or(f64::INFINITY, |r| 0.5 * r.norm_squared());
        }
        for prior in &self.bias_priors {
            cost += 0.5 * prior.residual(&motions[prior.frame].bias).0.norm_squared();
        }
        for still in &self.zero_velocities {
            cost += 0.5 * still.residual(&motions[still.frame]).norm_squared();
        }
        if cost.is_finite() { cost } else { f64::INFINITY }
    }

    /// For each key frame the place of its motion among the free variables, when it is free and something touches it.
    fn own(&self) -> Vec<Option<usize>> {
        let mut touched = vec![false; self.motions.len()];
        self.links.iter().for_each(|l| (touched[l.from], touched[l.to]) = (true, true));
        self.bias_priors.iter().for_each(|p| touched[p.frame] = true);
        self.zero_velocities.iter().for_each(|z| touched[z.frame] = true);
        let mut next = 0;
        let free = self.motions.iter().map(|m| m.freedom != MotionFreedom::Fixed);
        let place = free.zip(touched).map(|(free, touched)| {
            (free && touched).then(|| {
                next += 1;
                next - 1
            })
        });
        place.collect()
    }

    /// The lever arm among the free variables, after all motions.
    fn own_arm(&self) -> Option<Variable> {
        self.lever_arm.map(|_| Variable::Own(self.own().iter().flatten().count()))
    }

    /// The whitened residual of a link, and its Jacobian by pose and motion of either end, and by the lever arm.
    fn link(
        &self,
        link: &ImuLink,
        poses: &[Se3],
    ) -> Option<(SVector<f64, ROWS>, SMatrix<f64, ROWS, COLUMNS>)> {
        let nav = |i: usize| self.nav(i, poses, &self.motions, self.arm());
        let l = link.sum.linearise(&nav(link.from), &nav(link.to), &self.gravity);
        let white = link.sum.whitening()?;
        let mut jacobian = SMatrix::<f64, ROWS, COLUMNS>::zeros();
        for (at, frame, by) in [(0, link.from, &l.by_from), (15, link.to, &l.by_to)] {
            let by_pose: SMatrix<f64, ROWS, 6> = by.fixed_view::<ROWS, 6>(0, 0).into();
            let mount = self.mount(frame, self.arm());
            jacobian.fixed_view_mut::<ROWS, 6>(0, at).copy_from(&(by_pose * mount.adjoint()));
            // With the camera where it is, an IMU is as much further back as the camera is further forward on it.
            if !self.other_mounts.contains_key(&frame) {
                let mut by_arm = jacobian.fixed_view_mut::<ROWS, 3>(0, 30);
                by_arm -= by.fixed_view::<ROWS, 3>(0, 0);
            }
            let by_motion = by.fixed_view::<ROWS, MOTION>(0, 6);
            jacobian.fixed_view_mut::<ROWS, MOTION>(0, at + 6).copy_from(&by_motion);
        }
        Some((white * l.residual, white * jacobian))
    }
}

impl Factors for ImuFactors {
    fn sizes(&self) -> Vec<usize> {
        let motions = std::iter::repeat_n(MOTION, self.own().iter().flatten().count());
        motions.chain(self.lever_arm.map(|_| 3)).collect()
    }

    fn held(&self) -> Vec<(usize, Range<usize>)> {
        let own = self.own();
        let held = self.motions.iter().zip(own).filter(|(m, _)| m.freedom == MotionFreedom::Biases);
        held.filter_map(|(_, own)| Some((own?, 0..3))).collect()
    }

    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        let (own, arm) = (self.own(), self.own_arm());
        for link in &self.links {
            let motions = [link.from, link.to].into_iter().filter_map(|i| Some(Variable::Own(own[i]?)));
            let poses = [Variable::Pose(link.from), Variable::Pose(link.to)];
            visit(&poses.into_iter().chain(motions).chain(arm).collect::<Vec<_>>());
        }
        visit(arm.as_slice());
        let still = self.zero_velocities.iter().map(|z| z.frame);
        for frame in self.bias_priors.iter().map(|p| p.frame).chain(still) {
            visit(own[frame].map(Variable::Own).as_slice());
        }
    }

    /// Links whose bias has moved far are preintegrated again first.
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        for link in &mut self.links {
            link.sum.follow(&self.motions[link.from].bias);
        }
        let own: Vec<Option<Variable>> = self.own().into_iter().map(|i| i.map(Variable::Own)).collect();
        let arm = self.own_arm();
        for link in &self.links {
            let (residual, jacobian) = self.link(link, poses)?;
            let parts = [
                (Some(Variable::Pose(link.from)), 0..6),
                (own[link.from], 6..15),
                (Some(Variable::Pose(link.to)), 15..21),
                (own[link.to], 21..30),
                (arm, 30..33),
            ];
            equations.add(&residual, &jacobian, &parts);
        }
        if let Some(prior) = &self.lever_arm {
            let jacobian = SMatrix::<f64, 3, 3>::identity() / prior.sigma;
            equations.add(&prior.residual(self.arm()), &jacobian, &[(arm, 0..3)]);
        }
        for prior in &self.bias_priors {
            let (residual, by) = prior.residual(&self.motions[prior.frame].bias);
            let mut jacobian = SMatrix::<f64, 6, MOTION>::zeros();
            (0..6).for_each(|i| jacobian[(i, 3 + i)] = by[i]);
            equations.add(&residual, &jacobian, &[(own[prior.frame], 0..MOTION)]);
        }
        for still in &self.zero_velocities {
            let residual = still.residual(&self.motions[still.frame]);
            let mut jacobian = SMatrix::<f64, 3, MOTION>::zeros();
            (0..3).for_each(|i| jacobian[(i, i)] = 1.0 / still.sigma);
            equations.add(&residual, &jacobian, &[(own[still.frame], 0..MOTION)]);
        }
        Some(())
    }

    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        let moved = |(motion, own): (&SpeedAndBias, Option<usize>)| match own {
            Some(own) => motion.moved(&step[own * MOTION..(own + 1) * MOTION]),
            None => *motion,
        };
        self.trial = self.motions.iter().zip(self.own()).map(moved).collect();
        self.trial_arm = *self.arm();
        if self.lever_arm.is_some() {
            self.trial_arm += Vec3::from_column_slice(&step[step.len() - 3..]);
        }
        self.cost(poses, &self.trial, &self.trial_arm)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.motions, &mut self.trial);
        self.imu_from_camera.translation = self.trial_arm;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Manifold, So3};
    use cairn_sensor::{ImuNoise, ImuSample, Stamp};

    /// The columns of a link's Jacobian against central differences of its whitened residual.
    #[test]
    fn link_jacobian_matches_differences() {
        let noise = ImuNoise { gyro: 1.7e-4, gyro_walk: 2e-5, accel: 2e-3, accel_walk: 3e-3 };
        let reading = |i: i64| {
            let t = i as f64 * 0.005;
            let (gyro, accel) = (Vec3::new(0.3, t, -0.2), Vec3::new(0.5, 9.5 + t, 1.0));
            ImuSample::new(Stamp(i * 5_000_000), gyro, accel)
        };
        let sum = Preintegrated::of(noise, Bias::default(), (0..=40).map(reading).collect());
        let camera = Se3::new(So3::exp(&Vec3::new(1.2, -1.1, 1.3)), Vec3::new(0.07, -0.02, 0.05));
        let pose = |k: f64| Se3::new(So3::exp(&Vec3::new(0.1 * k, 0.2, -0.3)), Vec3::new(k, 0.5, -0.2 * k));
        let poses = [pose(1.0), pose(1.4)];
        let motion = |k: f64| SpeedAndBias {
            velocity: Vec3::new(1.0, k, 0.2),
            bias: Bias { gyro: Vec3::new(0.001, 0.0, 0.002 * k), accel: Vec3::new(0.02, 0.01 * k, 0.0) },
            freedom: MotionFreedom::Free,
        };
        let mut factors = ImuFactors::new(camera, Gravity::level(), vec![motion(0.3), motion(0.5)]);
        // One end is of another rig.
        let other = Se3::new(So3::exp(&Vec3::new(-0.4, 0.2, 1.0)), Vec3::new(0.2, 0.1, -0.1));
        factors.other_mounts.insert(1, other);
        let link = ImuLink { from: 0, to: 1, sum };
        let (_, jacobian) = factors.link(&link, &poses).expect("readings");
        for column in 0..COLUMNS {
            let at = |h: f64| {
                let (mut poses, mut motions, mut arm) = (poses, factors.motions.clone(), *factors.arm());
                let (end, within) = (column / 15, column % 15);
                if end == 2 {
                    arm[within] += h;
                } else if within < 6 {
                    let mut d = SVector::<f64, 6>::zeros();
                    d[within] = h;
                    poses[end] = poses[end].retract(&d);
                } else {
                    let mut d = [0.0; MOTION];
                    d[within - 6] = h;
                    motions[end] = motions[end].moved(&d);
                }
                factors.whitened(&link, &poses, &motions, &arm).expect("readings")
            };
            let h = 1e-6;
            let numeric = (at(h) - at(-h)) / (2.0 * h);
            let (largest, off) = (numeric.amax().max(1.0), (numeric - jacobian.column(column)).amax());
            assert!(off < 1e-4 * largest, "column {column}: {off} of {largest}");
        }
    }
}
