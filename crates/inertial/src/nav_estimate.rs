//! Error-state Kalman filter of camera pose, velocity and biases: predicted by IMU readings, corrected by visual poses.
//!
//! A Kalman filter over the error of a state (Solà, "Quaternion kinematics for the error-state Kalman filter", 2017, section
//! 6), with preintegration as its process model: the covariance goes through the Jacobians of the inertial residual. The
//! step between two frames is thus the adjustment of both with the earlier one marginalised.

use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Manifold, Se3, So3, Vec3};
use nalgebra::{Cholesky, SMatrix, SVector};

/// Unknowns: translation and rotation of the camera, velocity, gyro bias, accel bias, direction of gravity.
const N: usize = 17;
/// Those of the sensor at one instant: all but gravity, which is the same at each.
const M: usize = 15;
/// The first of the biases and of gravity.
const BIAS: usize = 9;

/// State of camera and IMU with its covariance.
#[derive(Clone, Debug)]
pub struct NavEstimate {
    /// Pose of the camera, metres, in a gravity-aligned world.
    pub world_from_camera: Se3,
    /// The sensor's velocity in the world, m/s.
    pub velocity: Vec3,
    /// The sensor's biases.
    pub bias: Bias,
    /// Gravity in the world. How well the world is aligned with it is not better known than the accelerometer's bias: a walk
    /// straight on tells the sum of both only.
    pub gravity: Gravity,
    /// Over (translation, rotation) of the camera along its own axes, velocity, gyro bias, accel bias, and the tilt of
    /// gravity ([`Gravity`]'s tangent).
    pub covariance: SMatrix<f64, N, N>,
}

/// What is known of the direction of gravity and of the accelerometer's bias together, where only their sum was seen.
#[derive(Clone, Copy, Debug)]
pub struct Level {
    /// Standard deviation of the bias across gravity, m/s^2.
    pub bias: f64,
    /// Of the bias along gravity, m/s^2.
    pub bias_along: f64,
    /// Of the direction of gravity with the bias known, radians.
    pub tilt: f64,
}

impl Level {
    /// Over accel bias and tilt. A specific force that was seen holds `bias = -world_from_imu' gravity`, up to a constant: the
    /// tilt is what the bias makes of it, plus what is left.
    fn covariance(&self, gravity: &Gravity, world_from_imu: So3) -> SMatrix<f64, 5, 5> {
        let rotation = world_from_imu.matrix();
        let up = -gravity.vector() / gravity.magnitude;
        let along = up * up.transpose();
        let variance =
            (nalgebra::Matrix3::identity() - along) * self.bias.powi(2) + along * self.bias_along.powi(2);
        let bias = rotation.transpose() * variance * rotation;
        let tilt_by_bias = gravity.jacobian().transpose() * rotation / gravity.magnitude.powi(2);
        let mut out = SMatrix::<f64, 5, 5>::zeros();
        out.fixed_view_mut::<3, 3>(0, 0).copy_from(&bias);
        out.fixed_view_mut::<2, 3>(3, 0).copy_from(&(tilt_by_bias * bias));
        out.fixed_view_mut::<3, 2>(0, 3).copy_from(&(bias * tilt_by_bias.transpose()));
        let own = tilt_by_bias * bias * tilt_by_bias.transpose()
            + nalgebra::Matrix2::identity() * self.tilt.powi(2);
        out.fixed_view_mut::<2, 2>(3, 3).copy_from(&own);
        out
    }
}

impl NavEstimate {
    /// A state in a world that is level, with independent standard deviations: metres, radians, m/s, rad/s, m/s^2; `level` of
    /// the direction of gravity, beyond what the accelerometer's bias makes of it, radians.
    pub fn new(
        world_from_camera: Se3,
        velocity: Vec3,
        bias: Bias,
        sigmas: [f64; 5],
        level: &Level,
        imu_from_camera: &Se3,
    ) -> Self {
        let mut covariance =
            SMatrix::from_diagonal(&SVector::<f64, N>::from_fn(|i, _| sigmas[(i / 3).min(4)].powi(2)));
        let gravity = Gravity::level();
        let world_from_imu = world_from_camera.rotation * imu_from_camera.rotation.inverse();
        let own = level.covariance(&gravity, world_from_imu);
        covariance.fixed_view_mut::<5, 5>(12, 12).copy_from(&own);
        Self { world_from_camera, velocity, bias, gravity, covariance }
    }

    /// The sensor's state.
    pub fn nav(&self, imu_from_camera: &Se3) -> NavState {
        let world_from_imu = self.world_from_camera * imu_from_camera.inverse();
        NavState { world_from_imu, velocity: self.velocity, bias: self.bias }
    }

    /// The prediction at the end of preintegrated readings that begin at this instant; `None` when they are empty.
    pub fn after(&self, sum: &Preintegrated, imu_from_camera: &Se3) -> Option<Self> {
        if sum.seconds() <= 0.0 {
            return None;
        }
        let from = self.nav(imu_from_camera);
        let to = sum.predict(&from, &self.gravity.vector());
        let l = sum.linearise(&from, &to, &self.gravity);
        let adjoint = imu_from_camera.adjoint();
        let of_camera = |by: &SMatrix<f64, M, M>| {
            let mut out = *by;
            let pose = by.fixed_view::<M, 6>(0, 0) * adjoint;
            out.fixed_view_mut::<M, 6>(0, 0).copy_from(&pose);
            out
        };
        // residual(from, to) is the noise: to first order, by_from d_from + by_to d_to + by_gravity d_gravity = noise.
        let back = of_camera(&l.by_to).try_inverse()?;
        let mut step = SMatrix::<f64, N, N>::identity();
        step.fixed_view_mut::<M, M>(0, 0).copy_from(&(-back * of_camera(&l.by_from)));
        step.fixed_view_mut::<M, 2>(0, M).copy_from(&(-back * l.by_gravity));
        let mut covariance = step * self.covariance * step.transpose();
        let mut own = covariance.fixed_view_mut::<M, M>(0, 0);
        own += back * sum.covariance() * back.transpose();
        let covariance = symmetric(&covariance);
        let world_from_camera = to.world_from_imu * *imu_from_camera;
        Some(Self {
            world_from_camera,
            velocity: to.velocity,
            bias: to.bias,
            gravity: self.gravity,
            covariance,
        })
    }

    /// With the biases and the gravity of another estimate, and what that knows of them.
    pub fn with_biases_of(mut self, other: &Self) -> Self {
        (self.bias, self.gravity) = (other.bias, other.gravity);
        let own = other.covariance.fixed_view::<{ N - BIAS }, { N - BIAS }>(BIAS, BIAS);
        self.covariance.fixed_view_mut::<{ N - BIAS }, { N - BIAS }>(BIAS, BIAS).copy_from(&own);
        self
    }

    /// Information over the pose alone, everything else marginalised.
    pub fn pose_information(&self) -> Option<SMatrix<f64, 6, 6>> {
        Some(Cholesky::new(self.pose_covariance())?.inverse())
    }

    /// The estimate once the pose is known with a covariance that includes this estimate of it; everything else is corrected
    /// by its correlation.
    pub fn seen(&self, world_from_camera: &Se3, covariance: &SMatrix<f64, 6, 6>) -> Option<Self> {
        let before = Cholesky::new(self.pose_covariance())?;
        let all_by_pose = self.covariance.fixed_view::<N, 6>(0, 0).into_owned();
        let gain = before.solve(&all_by_pose.transpose()).transpose();
        let step = gain * self.world_from_camera.local(world_from_camera);
        let narrowed = gain * (self.pose_covariance() - covariance) * gain.transpose();
        let after = self.moved(&step);
        Some(Self {
            world_from_camera: *world_from_camera,
            covariance: symmetric(&(self.covariance - narrowed)),
            ..after
        })
    }

    /// Takes over a correction of the map: the camera has this pose now, and keeps its velocity and gravity along its own
    /// axes.
    pub fn carry_to(&mut self, world_from_camera: Se3) {
        let turned = world_from_camera.rotation * self.world_from_camera.rotation.inverse();
        let turn = turned.matrix();
        self.velocity = turn * self.velocity;
        self.gravity.world_from_level = turned * self.gravity.world_from_level;
        let rows = turn * self.covariance.fixed_view::<3, N>(6, 0);
        self.covariance.fixed_view_mut::<3, N>(6, 0).copy_from(&rows);
        let columns = self.covariance.fixed_view::<N, 3>(0, 6) * turn.transpose();
        self.covariance.fixed_view_mut::<N, 3>(0, 6).copy_from(&columns);
        self.world_from_camera = world_from_camera;
    }

    /// Zero-velocity update with this standard deviation in m/s.
    pub fn at_rest(&self, sigma: f64) -> Option<Self> {
        let all_by_velocity = self.covariance.fixed_view::<N, 3>(0, 6).into_owned();
        let mut own: SMatrix<f64, 3, 3> = self.covariance.fixed_view::<3, 3>(6, 6).into();
        for i in 0..3 {
            own[(i, i)] += sigma * sigma;
        }
        let gain = Cholesky::new(own)?.solve(&all_by_velocity.transpose()).transpose();
        let after = self.moved(&(gain * -self.velocity));
        Some(Self { covariance: symmetric(&(self.covariance - gain * all_by_velocity.transpose())), ..after })
    }

    /// Standard deviation of the position in its least certain direction, metres.
    pub fn position_sigma(&self) -> f64 {
        let own: SMatrix<f64, 3, 3> = self.covariance.fixed_view::<3, 3>(0, 0).into();
        own.symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// Standard deviation of the direction about its least certain axis, radians.
    pub fn rotation_sigma(&self) -> f64 {
        let own: SMatrix<f64, 3, 3> = self.covariance.fixed_view::<3, 3>(3, 3).into();
        own.symmetric_eigenvalues().max().max(0.0).sqrt()
    }

    /// Covariance of the pose, of its right perturbation: translation, rotation.
    pub fn pose_covariance(&self) -> SMatrix<f64, 6, 6> {
        self.covariance.fixed_view::<6, 6>(0, 0).into()
    }

    fn moved(&self, d: &SVector<f64, N>) -> Self {
        let part = |i: usize| -> Vec3 { d.fixed_rows::<3>(i).into() };
        let bias = Bias { gyro: self.bias.gyro + part(9), accel: self.bias.accel + part(12) };
        Self {
            world_from_camera: self.world_from_camera.retract(&d.fixed_rows::<6>(0).into()),
            velocity: self.velocity + part(6),
            bias,
            gravity: self.gravity.retract(&d.fixed_rows::<2>(M).into()),
            covariance: self.covariance,
        }
    }
}

fn symmetric(m: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let mut out = (m + m.transpose()) * 0.5;
    for i in 0..N {
        out[(i, i)] = out[(i, i)].max(1e-18);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;
    use cairn_random::Random;
    use cairn_sensor::{ImuNoise, ImuSample, Stamp};

    const NOISE: ImuNoise = ImuNoise { gyro: 2e-3, gyro_walk: 1e-4, accel: 2e-2, accel_walk: 1e-3 };
    const LEVEL: Level = Level { bias: 0.1, bias_along: 0.05, tilt: 0.01 };
    const SIGMAS: [f64; 5] = [0.01, 0.01, 0.05, 0.01, 0.05];

    fn imu_from_camera() -> Se3 {
        Se3::new(So3::exp(&Vec3::new(1.2, -1.2, 1.2)), Vec3::new(0.05, -0.02, 0.1))
    }

    /// Half a second of swinging motion, measured with noise at 200 Hz; the true state at its end.
    fn integrated(from: &NavState, gravity: &Gravity, rng: &mut Random) -> (Preintegrated, NavState) {
        let (mut state, mut bias, mut samples) = (*from, from.bias, Vec::new());
        let dt = 0.005_f64;
        let mut draw = |sigma: f64| {
            Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma
        };
        let readings = |i: usize| {
            let t = i as f64 * dt;
            (Vec3::new((3.0 * t).sin(), 0.5, (2.0 * t).cos()), Vec3::new(t.cos(), 2.0 * (5.0 * t).sin(), 9.8))
        };
        for i in 0..=100 {
            let (turn, force) = readings(i);
            let stamp = Stamp::from_seconds(i as f64 * dt);
            let gyro = turn + bias.gyro + draw(NOISE.gyro / dt.sqrt());
            let accel = force + bias.accel + draw(NOISE.accel / dt.sqrt());
            samples.push(ImuSample::new(stamp, gyro, accel));
            bias.gyro += draw(NOISE.gyro_walk * dt.sqrt());
            bias.accel += draw(NOISE.accel_walk * dt.sqrt());
        }
        let exact = (0..=100).map(|i| {
            let (turn, force) = readings(i);
            ImuSample::new(Stamp::from_seconds(i as f64 * dt), turn, force)
        });
        let truth = Preintegrated::of(NOISE, Bias::default(), exact.collect());
        state.bias = Bias::default();
        state = truth.predict(&state, &gravity.vector());
        state.bias = bias;
        (Preintegrated::of(NOISE, Bias::default(), samples), state)
    }

    /// Predicted and corrected: the error agrees with the covariance, in the mean over 300 runs.
    #[test]
    fn errors_agree_with_the_covariance() {
        let mut rng = Random::new(5);
        let arm = imu_from_camera();
        let mut sums = [0.0; 2];
        for _ in 0..300 {
            let mut draw = |sigma: f64| {
                Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * sigma
            };
            let prior = NavEstimate::new(
                Se3::new(So3::exp(&Vec3::new(0.3, 1.0, -0.4)), Vec3::new(1.0, 2.0, 0.5)),
                Vec3::new(0.5, -0.3, 0.1),
                Bias::default(),
                SIGMAS,
                &LEVEL,
                &arm,
            );
            let unit = SVector::<f64, N>::from_fn(|_, _| draw(1.0).x);
            let d = Cholesky::new(prior.covariance).unwrap().l() * unit;
            let (pose_noise, turn_noise) = (draw(0.005), draw(0.003));
            let truth = prior.moved(&d);
            let (sum, end) = integrated(&truth.nav(&arm), &truth.gravity, &mut rng);
            let carried = prior.after(&sum, &arm).unwrap();
            let true_camera = end.world_from_imu * arm;
            let error = |b: &NavEstimate| {
                let mut e = SVector::<f64, N>::zeros();
                e.fixed_rows_mut::<6>(0).copy_from(&b.world_from_camera.local(&true_camera));
                e.fixed_rows_mut::<3>(6).copy_from(&(end.velocity - b.velocity));
                e.fixed_rows_mut::<3>(9).copy_from(&(end.bias.gyro - b.bias.gyro));
                e.fixed_rows_mut::<3>(12).copy_from(&(end.bias.accel - b.bias.accel));
                e.fixed_rows_mut::<2>(M).copy_from(&b.gravity.local(&truth.gravity));
                e.dot(&Cholesky::new(b.covariance).unwrap().solve(&e))
            };
            sums[0] += error(&carried);
            // A visual pose with noise, combined with the prediction.
            let mut noise = SVector::<f64, 6>::zeros();
            noise.fixed_rows_mut::<3>(0).copy_from(&pose_noise);
            noise.fixed_rows_mut::<3>(3).copy_from(&turn_noise);
            let measured = true_camera.retract(&noise);
            let own = SMatrix::<f64, 6, 6>::from_diagonal(&SVector::from_fn(|i, _| {
                if i < 3 { 0.005_f64.powi(-2) } else { 0.003_f64.powi(-2) }
            }));
            let predicted = carried.pose_information().unwrap();
            let covariance = (own + predicted).try_inverse().unwrap();
            let pull = covariance * own * carried.world_from_camera.local(&measured);
            let seen = carried.seen(&carried.world_from_camera.retract(&pull), &covariance).unwrap();
            sums[1] += error(&seen);
            assert!(seen.position_sigma() < carried.position_sigma());
        }
        for mean in sums.map(|s| s / 300.0) {
            assert!(
                (15.5..18.5).contains(&mean),
                "mean squared error over covariance: {sums:?}, 17 is right"
            );
        }
    }

    #[test]
    fn zero_velocity_update_stops_it() {
        let moving = NavEstimate::new(
            Se3::identity(),
            Vec3::new(0.2, 0.0, -0.1),
            Bias::default(),
            [0.1, 0.1, 0.3, 0.01, 0.1],
            &LEVEL,
            &Se3::identity(),
        );
        let still = moving.at_rest(1e-3).unwrap();
        assert!(still.velocity.norm() < 1e-5 && still.covariance[(6, 6)] < 1.1e-6);
        assert_eq!(still.world_from_camera, moving.world_from_camera);
    }
}
