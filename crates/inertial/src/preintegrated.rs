//! IMU preintegration: readings between two instants integrated once, in the frame of the first, independent of its pose,
//! velocity and gravity.
//!
//! Source: Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration for real-time visual-inertial odometry"
//! (TRO 2017): the sums of eq. 33 by the midpoint rule, noise as in eq. 59-63 (each step's from the step's own
//! Jacobians), bias Jacobians as in appendix B, first-order bias correction eq. 44. The biases' random walk is carried
//! along, so that the covariance has fifteen dimensions (rotation, velocity, position, gyro bias, accel bias) and the
//! biases' change is correlated with what it does to the rest.

use crate::{Bias, NavState};
use cairn_geometry::{Mat3, Se3, So3, Vec3, hat};
use cairn_sensor::{ImuNoise, ImuSample, Stamp};
use nalgebra::SMatrix;

/// Variance that a position gains a second, m^2/s: keeps the covariance of a single step regular.
const POSITION_NOISE: f64 = 1e-10;

/// A change of the gyroscope's bias that turns the sum by more than this, radians, requires reintegration: the first-order
/// correction is then wrong by about half its square.
const FAR_RAD: f64 = 5e-3;
/// The same for the accelerometer's bias, m/s^2. It enters linearly; only the product of both changes is lost.
const FAR_M_S2: f64 = 0.5;

/// Preintegrated readings between two instants.
#[derive(Clone, Debug)]
pub struct Preintegrated {
    noise: ImuNoise,
    bias: Bias,
    samples: Vec<ImuSample>,
    sums: Sums,
    blocks: Blocks,
}

/// Rotation, velocity and position gained in the frame of the first instant, and their derivatives by the biases.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    pub seconds: f64,
    pub rotation: So3,
    pub velocity: Vec3,
    pub position: Vec3,
    pub rotation_by_gyro: Mat3,
    pub velocity_by_gyro: Mat3,
    pub velocity_by_accel: Mat3,
    pub position_by_gyro: Mat3,
    pub position_by_accel: Mat3,
}

/// Covariance by 3x3 blocks: the upper triangle of (r, v, p), and their correlation with the biases (g, a), whose own
/// covariances are multiples of the identity. Rotation and accel bias have none.
#[derive(Clone, Copy, Debug)]
struct Blocks {
    rr: Mat3,
    rv: Mat3,
    rp: Mat3,
    vv: Mat3,
    vp: Mat3,
    pp: Mat3,
    rg: Mat3,
    vg: Mat3,
    pg: Mat3,
    va: Mat3,
    pa: Mat3,
    gg: f64,
    aa: f64,
}

impl Preintegrated {
    /// An empty sum, linearised at a bias.
    pub fn new(noise: ImuNoise, bias: Bias) -> Self {
        Self { noise, bias, samples: Vec::new(), sums: Sums::new(), blocks: Blocks::new() }
    }

    /// The sum of samples in rising time, from the first to the last.
    pub fn of(noise: ImuNoise, bias: Bias, samples: Vec<ImuSample>) -> Self {
        let mut sum = Self { samples, ..Self::new(noise, bias) };
        sum.integrate();
        sum
    }

    /// Adds a sample: the step from the last one to it. One that does not lie after the last changes nothing.
    pub fn push(&mut self, sample: ImuSample) {
        if let Some(last) = self.samples.last().copied() {
            if sample.stamp <= last.stamp {
                return;
            }
            self.step(&last, &sample);
        }
        self.samples.push(sample);
    }

    /// Appends readings that begin where these end; integrated at this one's bias.
    pub fn append(&mut self, next: &Preintegrated) {
        for sample in &next.samples {
            self.push(*sample);
        }
    }

    /// Integrates again at another bias.
    pub fn reintegrate(&mut self, bias: Bias) {
        self.bias = bias;
        self.integrate();
    }

    /// True when a bias is so far from the one of the linearisation that the first-order correction is not enough.
    pub fn is_far(&self, bias: &Bias) -> bool {
        (bias.gyro - self.bias.gyro).norm() * self.sums.seconds > FAR_RAD
            || (bias.accel - self.bias.accel).norm() > FAR_M_S2
    }

    /// Integrates again when [`Preintegrated::is_far`].
    pub fn follow(&mut self, bias: &Bias) {
        if self.is_far(bias) {
            self.reintegrate(*bias);
        }
    }

    /// Seconds from the first sample to the last.
    pub fn seconds(&self) -> f64 {
        self.sums.seconds
    }

    /// The bias it is linearised at.
    pub fn bias(&self) -> &Bias {
        &self.bias
    }

    /// The noise densities it was integrated with.
    pub fn noise(&self) -> &ImuNoise {
        &self.noise
    }

    /// Its samples, first and last at its ends.
    pub fn samples(&self) -> &[ImuSample] {
        &self.samples
    }

    /// When it begins and ends; `None` while it has no sample.
    pub fn span(&self) -> Option<(Stamp, Stamp)> {
        Some((self.samples.first()?.stamp, self.samples.last()?.stamp))
    }

    pub(crate) fn sums(&self) -> &Sums {
        &self.sums
    }

    /// Rotation, velocity and position gained, corrected to a bias to first order (eq. 44).
    pub fn gained(&self, bias: &Bias) -> (So3, Vec3, Vec3) {
        let s = &self.sums;
        let (g, a) = (bias.gyro - self.bias.gyro, bias.accel - self.bias.accel);
        (
            s.rotation * So3::exp(&(s.rotation_by_gyro * g)),
            s.velocity + s.velocity_by_gyro * g + s.velocity_by_accel * a,
            s.position + s.position_by_gyro * g + s.position_by_accel * a,
        )
    }

    /// The state at its end, from that at its beginning; `gravity` in the world, m/s^2 (eq. 26 solved for the end).
    pub fn predict(&self, from: &NavState, gravity: &Vec3) -> NavState {
        let (rotation, velocity, position) = self.gained(&from.bias);
        let (t, r) = (self.sums.seconds, from.world_from_imu.rotation);
        let place =
            from.world_from_imu.translation + from.velocity * t + gravity * (0.5 * t * t) + r * position;
        NavState {
            world_from_imu: Se3::new(r * rotation, place),
            velocity: from.velocity + gravity * t + r * velocity,
            bias: from.bias,
        }
    }

    /// Covariance of (rotation, velocity, position) gained and of what the (gyro, accel) biases wandered meanwhile:
    /// rad, m/s, m, rad/s, m/s^2, all in the frame of the first instant but the rotation, which is in that of the last.
    pub fn covariance(&self) -> SMatrix<f64, 15, 15> {
        let b = &self.blocks;
        let mut c = SMatrix::<f64, 15, 15>::zeros();
        let (gg, aa) = (Mat3::identity() * b.gg, Mat3::identity() * b.aa);
        let upper = [
            (0, 0, b.rr),
            (0, 3, b.rv),
            (0, 6, b.rp),
            (3, 3, b.vv),
            (3, 6, b.vp),
            (6, 6, b.pp),
            (0, 9, b.rg),
            (3, 9, b.vg),
            (6, 9, b.pg),
            (3, 12, b.va),
            (6, 12, b.pa),
            (9, 9, gg),
            (12, 12, aa),
        ];
        for (row, column, block) in upper {
            c.fixed_view_mut::<3, 3>(row, column).copy_from(&block);
            c.fixed_view_mut::<3, 3>(column, row).copy_from(&block.transpose());
        }
        c
    }

    /// The first nine dimensions of [`Preintegrated::covariance`].
    pub fn motion_covariance(&self) -> SMatrix<f64, 9, 9> {
        self.covariance().fixed_view::<9, 9>(0, 0).into()
    }

    fn integrate(&mut self) {
        (self.sums, self.blocks) = (Sums::new(), Blocks::new());
        let samples = std::mem::take(&mut self.samples);
        for pair in samples.windows(2) {
            self.step(&pair[0], &pair[1]);
        }
        self.samples = samples;
    }

    fn step(&mut self, first: &ImuSample, second: &ImuSample) {
        let dt = second.stamp - first.stamp;
        if dt <= 0.0 {
            return;
        }
        let scale = first.noise_scale.max(second.noise_scale);
        let rate = (first.gyro + second.gyro) * 0.5 - self.bias.gyro;
        let (a0, a1) = (first.accel - self.bias.accel, second.accel - self.bias.accel);
        let turn = rate * dt;
        let step = Step::new(&self.sums, &turn, &a0, &a1, dt);
        self.blocks.step(&step, &self.noise, scale);
        self.sums.step(&step);
    }
}

/// One step of the midpoint rule, with its derivatives.
struct Step {
    dt: f64,
    rotation: So3,
    /// Mean acceleration over the step.
    acceleration: Vec3,
    /// The rotation's error after by that before: the turn, transposed.
    f: Mat3,
    /// The rotation's error by the rate's.
    j: Mat3,
    /// The acceleration by the rotation's error before, by the gyro's bias, by the accel's.
    by_rotation: Mat3,
    by_gyro: Mat3,
    by_accel: Mat3,
}

impl Step {
    fn new(sums: &Sums, turn: &Vec3, a0: &Vec3, a1: &Vec3, dt: f64) -> Self {
        let exp = So3::exp(turn);
        let rotation = sums.rotation * exp;
        let (before, after) = (sums.rotation.matrix(), rotation.matrix());
        let f = exp.matrix().transpose();
        let j = So3::right_jacobian(turn) * dt;
        let late = after * hat(a1) * 0.5;
        Self {
            dt,
            rotation,
            acceleration: (before * a0 + after * a1) * 0.5,
            by_rotation: -(before * hat(a0) * 0.5 + late * f),
            by_gyro: late * j,
            by_accel: (before + after) * -0.5,
            f,
            j,
        }
    }
}

impl Sums {
    fn new() -> Self {
        Self {
            seconds: 0.0,
            rotation: So3::identity(),
            velocity: Vec3::zeros(),
            position: Vec3::zeros(),
            rotation_by_gyro: Mat3::zeros(),
            velocity_by_gyro: Mat3::zeros(),
            velocity_by_accel: Mat3::zeros(),
            position_by_gyro: Mat3::zeros(),
            position_by_accel: Mat3::zeros(),
        }
    }

    fn step(&mut self, s: &Step) {
        let (dt, half) = (s.dt, 0.5 * s.dt * s.dt);
        let by_gyro = s.by_rotation * self.rotation_by_gyro + s.by_gyro;
        self.position += self.velocity * dt + s.acceleration * half;
        self.velocity += s.acceleration * dt;
        self.position_by_gyro += self.velocity_by_gyro * dt + by_gyro * half;
        self.position_by_accel += self.velocity_by_accel * dt + s.by_accel * half;
        self.velocity_by_gyro += by_gyro * dt;
        self.velocity_by_accel += s.by_accel * dt;
        self.rotation_by_gyro = s.f * self.rotation_by_gyro - s.j;
        self.rotation = s.rotation;
        self.seconds += dt;
    }
}

impl Blocks {
    fn new() -> Self {
        let zero = Mat3::zeros();
        Self {
            rr: zero,
            rv: zero,
            rp: zero,
            vv: zero,
            vp: zero,
            pp: zero,
            rg: zero,
            vg: zero,
            pg: zero,
            va: zero,
            pa: zero,
            gg: 0.0,
            aa: 0.0,
        }
    }

    /// `A C A' + B Q B'` with `A` of rows (f 0 0 -j 0), (g 1 0 dg da), (g dt/2, dt, 1, dg dt/2, da dt/2), by blocks: the
    /// third row is always `dt/2 (second + v) + p`.
    fn step(&mut self, s: &Step, noise: &ImuNoise, scale: f64) {
        let (dt, half) = (s.dt, 0.5 * s.dt);
        let (f, g, dg, da) = (&s.f, s.by_rotation * dt, s.by_gyro * dt, s.by_accel * dt);
        let (vr, pr, pv) = (self.rv.transpose(), self.rp.transpose(), self.vp.transpose());
        let (gr, gv, gp) = (self.rg.transpose(), self.vg.transpose(), self.pg.transpose());
        let (av, ap) = (self.va.transpose(), self.pa.transpose());
        // X = A C, by rows; columns r, v, p, g, a.
        let x_rr = f * self.rr - s.j * gr;
        let x_rv = f * self.rv - s.j * gv;
        let x_rp = f * self.rp - s.j * gp;
        let x_rg = f * self.rg - s.j * self.gg;
        let x_vr = g * self.rr + vr + dg * gr;
        let x_vv = g * self.rv + self.vv + dg * gv + da * av;
        let x_vp = g * self.rp + self.vp + dg * gp + da * ap;
        let x_vg = g * self.rg + self.vg + dg * self.gg;
        let x_va = self.va + da * self.aa;
        let x_pr = (x_vr + vr) * half + pr;
        let x_pv = (x_vv + self.vv) * half + pv;
        let x_pp = (x_vp + self.vp) * half + self.pp;
        let x_pg = (x_vg + self.vg) * half + self.pg;
        let x_pa = (x_va + self.va) * half + self.pa;
        // C = X A'.
        let (ft, jt, gt, dgt, dat) =
            (f.transpose(), s.j.transpose(), g.transpose(), dg.transpose(), da.transpose());
        self.rr = x_rr * ft - x_rg * jt;
        let rv = x_rr * gt + x_rv + x_rg * dgt;
        self.rp = (rv + x_rv) * half + x_rp;
        self.rv = rv;
        let vv = x_vr * gt + x_vv + x_vg * dgt + x_va * dat;
        self.vp = (vv + x_vv) * half + x_vp;
        self.vv = vv;
        let pv = x_pr * gt + x_pv + x_pg * dgt + x_pa * dat;
        self.pp = (pv + x_pv) * half + x_pp;
        (self.rg, self.vg, self.pg, self.va, self.pa) = (x_rg, x_vg, x_pg, x_va, x_pa);
        self.add_noise(s, &dg, &da, noise, scale);
    }

    /// White noise of densities `sigma` is `sigma / sqrt(dt)` over a step; the biases walk `sigma_walk sqrt(dt)`.
    fn add_noise(&mut self, s: &Step, dg: &Mat3, da: &Mat3, noise: &ImuNoise, scale: f64) {
        let half = 0.5 * s.dt;
        let gyro = (noise.gyro * scale).powi(2) / s.dt;
        let accel = (noise.accel * scale).powi(2) / s.dt;
        self.rr += s.j * s.j.transpose() * gyro;
        // The rate's noise and the bias have opposite signs.
        self.rv -= s.j * dg.transpose() * gyro;
        self.rp -= s.j * dg.transpose() * (gyro * half);
        let v = dg * dg.transpose() * gyro + da * da.transpose() * accel;
        self.vv += v;
        self.vp += v * half;
        self.pp += v * (half * half) + Mat3::identity() * (POSITION_NOISE * s.dt);
        self.gg += noise.gyro_walk.powi(2) * s.dt;
        self.aa += noise.accel_walk.powi(2) * s.dt;
    }
}
