//! The measurements of an inertial initialisation, its unknowns, and its cost.
//!
//! Per key frame nine unknowns: the error of its position (map units, world axes), of its rotation (the IMU's axes), its
//! velocity (m/s, world). Shared by all: log scale, gravity's tilt (2), gravity's norm (fixed, except in one
//! check of what it would be), gyro bias (3), accel bias (3), what the camera's place on the IMU is off (3), and what is left of the
//! offset between the clocks of IMU and camera (Li, Mourikis, "Online temporal calibration for camera-IMU systems", IJRR 2014, eq. 5: readings of a key
//! frame's stamp are of a pose that is the offset later, along the velocity and the turning rate). Levenberg-Marquardt on
//! [`Chain`].

use super::chain::{Block, Chain, SHARED, STATE, Step};
use super::input::{InitialiseConfig, Scale, Seen};
use super::link::Link;
use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Manifold, Mat3, Se3, So3, Vec3, hat};
use cairn_sensor::GRAVITY_M_S2;
use nalgebra::{SMatrix, SVector, Vector2};

/// Standard deviation that holds gravity's norm, relative.
pub const NORM_SIGMA: f64 = 1e-5;

/// Where the biases stand among the shared unknowns: gyro (3), accel (3).
pub const BIAS: usize = 4;

/// Where the lever arm stands among them.
const ARM: usize = 11;
/// Standard deviation that holds it, metres.
const ARM_SIGMA_M: f64 = 1e-5;

/// The offset of the clocks changes by no more than this in a step of the solver, seconds.
const MOST_OFFSET_STEP_S: f64 = 0.02;

/// The measurements and settings.
pub struct Problem {
    pub rotations: Vec<So3>,
    /// Of the camera, in the map's units.
    pub places: Vec<Vec3>,
    /// The gyroscope's reading at each key frame, rad/s.
    pub rates: Vec<Vec3>,
    pub links: Vec<Link>,
    pub imu_from_camera: Se3,
    pub scale: Scale,
    pub config: InitialiseConfig,
    pub rotation_sigma: f64,
    pub position_sigma: f64,
    /// Of the gyroscope and the accelerometer.
    pub noise_times: [f64; 2],
}

/// The gyroscope's reading at each end of the links.
fn rates(links: &[Preintegrated]) -> Vec<Vec3> {
    let last = links.last().and_then(|link| link.samples().last());
    let firsts = links.iter().map(|link| link.samples().first());
    firsts.chain([last]).map(|sample| sample.map_or_else(Vec3::zeros, |s| s.gyro)).collect()
}

/// A state of the search.
#[derive(Clone)]
pub struct State {
    pub log_scale: f64,
    pub gravity: Gravity,
    pub bias: Bias,
    /// Seconds by which the readings are of later poses than their stamps say.
    pub offset_s: f64,
    /// What the camera is off, in the IMU's axes, from where it is said to be, metres.
    pub lever_arm: Vec3,
    pub errors: Vec<Vec3>,
    pub turns: Vec<Vec3>,
    pub velocities: Vec<Vec3>,
}

/// The whitened residual of a link and its derivatives, by the unknowns of its two key frames and by the shared ones.
pub struct Rows {
    pub by_first: Block,
    pub by_second: Block,
    pub by_shared: SMatrix<f64, 9, SHARED>,
    pub residual: SVector<f64, 9>,
    /// What the rows were whitened with.
    pub white: Block,
}

impl Problem {
    pub fn new(
        seen: &Seen,
        links: &[Preintegrated],
        imu_from_camera: &Se3,
        scale: Scale,
        config: &InitialiseConfig,
    ) -> Self {
        let camera_from_imu = imu_from_camera.rotation.inverse();
        Self {
            rotations: seen.poses.iter().map(|p| p.world_from_camera.rotation * camera_from_imu).collect(),
            places: seen.poses.iter().map(|p| p.world_from_camera.translation).collect(),
            rates: rates(links),
            links: links.iter().map(|link| Link::new(link, [config.noise_times; 2])).collect(),
            noise_times: [config.noise_times; 2],
            imu_from_camera: *imu_from_camera,
            scale,
            config: *config,
            rotation_sigma: seen.rotation_sigma.max(1e-6),
            position_sigma: seen.position_sigma.max(1e-9),
        }
    }

    pub fn scale_is_free(&self) -> bool {
        self.scale == Scale::Free
    }

    /// The whitened residual of a link; its first three rows are of the rotation alone.
    pub fn whitened(&self, s: &State, k: usize) -> Option<SVector<f64, 9>> {
        let link = &self.links[k];
        let r = link.sum().residual(&self.nav(s, k), &self.nav(s, k + 1), &s.gravity);
        Some(link.white()? * r.fixed_rows::<9>(0))
    }

    pub fn follow(&mut self, state: &State) {
        self.links.iter_mut().for_each(|link| link.follow(&state.bias));
    }

    pub fn moved(&self, s: &State, step: &Step) -> State {
        let shared = &step.shared;
        let part = |d: &SVector<f64, STATE>, i: usize| -> Vec3 { d.fixed_rows::<3>(i).into() };
        let turned = |turn: &Vec3, by: Vec3| (So3::exp(turn) * So3::exp(&by)).log();
        let mut gravity = s.gravity.retract(&Vector2::new(shared[1], shared[2]));
        gravity.magnitude *= 1.0 + shared[3];
        State {
            // One step may not change the scale more than threefold.
            log_scale: s.log_scale + shared[0].clamp(-1.1, 1.1),
            gravity,
            bias: Bias {
                gyro: s.bias.gyro + shared.fixed_rows::<3>(4),
                accel: s.bias.accel + shared.fixed_rows::<3>(7),
            },
            offset_s: s.offset_s + shared[10].clamp(-MOST_OFFSET_STEP_S, MOST_OFFSET_STEP_S),
            lever_arm: s.lever_arm + shared.fixed_rows::<3>(ARM),
            errors: s.errors.iter().zip(&step.states).map(|(e, d)| e + part(d, 0)).collect(),
            turns: s.turns.iter().zip(&step.states).map(|(t, d)| turned(t, part(d, 3))).collect(),
            velocities: s.velocities.iter().zip(&step.states).map(|(v, d)| v + part(d, 6)).collect(),
        }
    }

    /// How far the body turns at a key frame within the offset, in its own axes.
    fn turned(&self, s: &State, k: usize) -> So3 {
        So3::exp(&((self.rates[k] - s.bias.gyro) * s.offset_s))
    }

    /// Where the camera is on the IMU.
    pub fn lever_arm(&self, s: &State) -> Vec3 {
        self.imu_from_camera.translation + s.lever_arm
    }

    /// The sensor's state at a key frame, in metres; of the time that its readings are of.
    pub fn nav(&self, s: &State, k: usize) -> NavState {
        let seen = self.rotations[k] * So3::exp(&s.turns[k]);
        let camera = (self.places[k] + s.errors[k]) * s.log_scale.exp();
        let place = camera - seen * self.lever_arm(s) + s.velocities[k] * s.offset_s;
        let rotation = seen * self.turned(s, k);
        NavState { world_from_imu: Se3::new(rotation, place), velocity: s.velocities[k], bias: s.bias }
    }

    /// Standard deviations of the shared unknowns' priors, and the unknowns' differences from the prior means.
    fn priors(&self, s: &State, norm_sigma: f64) -> [(f64, f64); SHARED] {
        let (gyro, accel) = (self.config.gyro_bias_sigma, self.config.accel_bias_sigma);
        let scale = match self.scale {
            Scale::Free => 20.0,
            Scale::Known { sigma } => sigma.max(1e-6),
        };
        let norm = s.gravity.magnitude / GRAVITY_M_S2 - 1.0;
        let (g, a, l) = (s.bias.gyro, s.bias.accel, s.lever_arm);
        let arm = self.config.lever_arm_sigma.max(ARM_SIGMA_M);
        [
            (scale, s.log_scale),
            (1e3, 0.0),
            (1e3, 0.0),
            (norm_sigma, norm),
            (gyro, g.x),
            (gyro, g.y),
            (gyro, g.z),
            (accel, a.x),
            (accel, a.y),
            (accel, a.z),
            (self.config.offset_sigma_s.max(1e-6), s.offset_s),
            (arm, l.x),
            (arm, l.y),
            (arm, l.z),
        ]
    }

    fn prior_cost(&self, s: &State) -> f64 {
        let shared: f64 = self.priors(s, NORM_SIGMA).iter().map(|(sigma, off)| (off / sigma).powi(2)).sum();
        let places = s.errors.iter().map(Vec3::norm_squared).sum::<f64>() / self.position_sigma.powi(2);
        let turns = s.turns.iter().map(Vec3::norm_squared).sum::<f64>() / self.rotation_sigma.powi(2);
        0.5 * (shared + places + turns)
    }

    pub fn cost(&self, s: &State) -> Option<f64> {
        let mut cost = self.prior_cost(s);
        for k in 0..self.links.len() {
            cost += 0.5 * self.whitened(s, k)?.norm_squared();
        }
        cost.is_finite().then_some(cost)
    }

    pub fn linearise(&self, s: &State, norm_sigma: f64) -> Option<(f64, Chain)> {
        let n = self.places.len();
        let mut chain = Chain::new(n);
        let mut cost = self.prior_cost(s);
        for (i, (sigma, off)) in self.priors(s, norm_sigma).iter().enumerate() {
            chain.shared[(i, i)] += sigma.powi(-2);
            chain.shared_gradient[i] += off / sigma.powi(2);
        }
        for k in 0..n {
            for i in 0..3 {
                chain.diagonal[k][(i, i)] += self.position_sigma.powi(-2);
                chain.diagonal[k][(3 + i, 3 + i)] += self.rotation_sigma.powi(-2);
                // A weak prior: velocities of up to 1 km/s.
                chain.diagonal[k][(6 + i, 6 + i)] += 1e-6;
                chain.gradient[k][i] += s.errors[k][i] / self.position_sigma.powi(2);
                chain.gradient[k][3 + i] += s.turns[k][i] / self.rotation_sigma.powi(2);
            }
        }
        for k in 0..self.links.len() {
            let rows = self.rows(s, k)?;
            cost += 0.5 * rows.residual.norm_squared();
            chain.add(k, &rows.by_first, &rows.by_second, &rows.by_shared, &rows.residual);
        }
        cost.is_finite().then_some((cost, chain))
    }

    /// The whitened rows of a link.
    pub fn rows(&self, s: &State, k: usize) -> Option<Rows> {
        let (link, scale) = (&self.links[k], s.log_scale.exp());
        let (from, to) = (self.nav(s, k), self.nav(s, k + 1));
        let l = link.sum().linearise(&from, &to, &s.gravity);
        let white = link.white()?;
        let shift = (self.places[k + 1] + s.errors[k + 1] - self.places[k] - s.errors[k]) * scale;
        let by_first = self.by_state(&l.by_from, &from, s, k, scale);
        let by_second = self.by_state(&l.by_to, &to, s, k + 1, scale);
        let mut by_shared = SMatrix::<f64, 9, SHARED>::zeros();
        by_shared.set_column(0, &l.by_log_scale(&shift).fixed_rows::<9>(0));
        by_shared.fixed_view_mut::<9, 2>(0, 1).copy_from(&l.by_gravity.fixed_view::<9, 2>(0, 0));
        // By the logarithm of gravity's norm.
        let (t, g) = (link.sum().seconds(), from.world_from_imu.rotation.inverse() * s.gravity.vector());
        by_shared.fixed_view_mut::<3, 1>(3, 3).copy_from(&(g * -t));
        by_shared.fixed_view_mut::<3, 1>(6, 3).copy_from(&(g * (-0.5 * t * t)));
        by_shared.fixed_view_mut::<9, 6>(0, BIAS).copy_from(&l.by_from.fixed_view::<9, 6>(0, 9));
        let by_offset = self.by_offset(&l.by_from, &from, k) + self.by_offset(&l.by_to, &to, k + 1);
        by_shared.set_column(10, &by_offset);
        // position = camera - R arm, and so is each end's.
        for (by, k) in [(&l.by_from, k), (&l.by_to, k + 1)] {
            let by_arm = by.fixed_view::<9, 3>(0, 0) * self.turned(s, k).inverse().matrix();
            let mut columns = by_shared.fixed_columns_mut::<3>(ARM);
            columns -= by_arm;
        }
        Some(Rows {
            by_first: white * by_first,
            by_second: white * by_second,
            by_shared: white * by_shared,
            residual: white * l.residual.fixed_rows::<9>(0),
            white,
        })
    }

    /// A link's Jacobian by a key frame's nine unknowns from that by its tangent.
    fn by_state(&self, by: &SMatrix<f64, 15, 15>, at: &NavState, s: &State, k: usize, scale: f64) -> Block {
        let by_place: SMatrix<f64, 9, 3> = by.fixed_view::<9, 3>(0, 0).into();
        let by_turn: SMatrix<f64, 9, 3> = by.fixed_view::<9, 3>(0, 3).into();
        let to_imu: Mat3 = at.world_from_imu.rotation.matrix().transpose();
        let mut out = Block::zeros();
        out.fixed_view_mut::<9, 3>(0, 0).copy_from(&(by_place * to_imu * scale));
        // position = camera - R exp(turn) arm: turning moves the IMU about the camera.
        let back = self.turned(s, k).inverse().matrix();
        let turn = by_turn * back + by_place * back * hat(&self.lever_arm(s));
        out.fixed_view_mut::<9, 3>(0, 3).copy_from(&turn);
        let moved = by_place * to_imu * s.offset_s;
        out.fixed_view_mut::<9, 3>(0, 6).copy_from(&(by.fixed_view::<9, 3>(0, 6) + moved));
        out
    }

    /// The same by the offset of the clocks: the key frame goes on along its velocity and its turning rate.
    fn by_offset(&self, by: &SMatrix<f64, 15, 15>, at: &NavState, k: usize) -> SVector<f64, 9> {
        let velocity = at.world_from_imu.rotation.inverse() * at.velocity;
        by.fixed_view::<9, 3>(0, 0) * velocity + by.fixed_view::<9, 3>(0, 3) * (self.rates[k] - at.bias.gyro)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::initialise::SeenPose;
    use cairn_sensor::{ImuNoise, ImuSample, Stamp};
    use nalgebra::SMatrix;

    /// Three key frames of a motion that does not fit the readings, so that every residual counts.
    fn problem() -> (Problem, State) {
        let noise = ImuNoise { gyro: 1e-3, gyro_walk: 1e-4, accel: 1e-2, accel_walk: 1e-3 };
        let reading = |t: f64| {
            let gyro = Vec3::new(0.3 * t.sin(), 0.5, -0.2 * t);
            ImuSample::new(Stamp::from_seconds(t), gyro, Vec3::new(0.4, t.cos(), GRAVITY_M_S2))
        };
        let link = |k: usize| {
            let readings = (0..=20).map(|i| reading(0.3 * (k as f64 + f64::from(i) / 20.0))).collect();
            Preintegrated::of(noise, Bias::default(), readings)
        };
        let pose = |k: usize| {
            let t = 0.3 * k as f64;
            let turn = So3::exp(&Vec3::new(0.05 * t, 0.45 * t, 0.1 - 0.05 * t));
            let world_from_camera = Se3::new(turn, Vec3::new(t, 0.2 * t * t, 0.1));
            SeenPose { stamp: Stamp::from_seconds(t), world_from_camera }
        };
        let poses: Vec<SeenPose> = (0..3).map(pose).collect();
        let seen = Seen { poses: &poses, rotation_sigma: 0.01, position_sigma: 0.01 };
        let imu_from_camera = Se3::new(So3::exp(&Vec3::new(0.1, -0.2, 0.3)), Vec3::new(0.1, 0.05, -0.08));
        let config = InitialiseConfig {
            noise_times: 1.0,
            offset_sigma_s: 0.03,
            lever_arm_sigma: 0.04,
            ..Default::default()
        };
        let links = [link(0), link(1)];
        let problem = Problem::new(&seen, &links, &imu_from_camera, Scale::Free, &config);
        let gravity = Gravity::along(&Vec3::new(0.1, -0.05, -1.0), GRAVITY_M_S2).unwrap();
        let velocities = (0..3).map(|k| Vec3::new(1.2, 0.3 * f64::from(k), 0.1)).collect();
        let state = State {
            log_scale: 1.3f64.ln(),
            gravity,
            bias: Bias::default(),
            offset_s: 0.02,
            lever_arm: Vec3::new(0.02, -0.03, 0.01),
            errors: vec![Vec3::zeros(); 3],
            turns: vec![Vec3::zeros(); 3],
            velocities,
        };
        (problem, state)
    }

    #[test]
    fn gradient_agrees_with_differences_of_the_cost() {
        let (problem, state) = problem();
        let (_, chain) = problem.linearise(&state, NORM_SIGMA).unwrap();
        let n = state.velocities.len();
        let at = |of: Option<usize>, i: usize, by: f64| {
            let mut step = Step {
                states: vec![SVector::zeros(); n],
                shared: SVector::zeros(),
                covariance: SMatrix::zeros(),
                half_log_det: 0.0,
            };
            match of {
                Some(k) => step.states[k][i] = by,
                None => step.shared[i] = by,
            }
            problem.cost(&problem.moved(&state, &step)).unwrap()
        };
        let check = |of: Option<usize>, i: usize, analytic: f64| {
            let h = 1e-6;
            let numeric = (at(of, i, h) - at(of, i, -h)) / (2.0 * h);
            let scale = 1.0 + numeric.abs().max(analytic.abs());
            assert!((numeric - analytic).abs() < 2e-3 * scale, "{of:?} {i}: {numeric} {analytic}");
        };
        for k in 0..n {
            (0..STATE).for_each(|i| check(Some(k), i, chain.gradient[k][i]));
        }
        // Gravity's norm is held; that a bias turns the key frame within the offset is left out of the Jacobian.
        for i in [0, 1, 2, 7, 8, 9, 10, 11, 12, 13] {
            check(None, i, chain.shared_gradient[i]);
        }
    }
}
