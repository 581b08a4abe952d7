//! What errors that the [`Problem`] leaves out add to the covariance of its solution.
//!
//! The solver takes the accelerometer's sensitivity for exact and the biases for constant. Neither is so, and neither is
//! white noise: more readings do not average it out. Estimating them too would need priors that say little more than that,
//! and their errors would be taken up by whatever else is uncertain. So the estimate stays as it is, and its covariance
//! states what they may have done to it: they are the consider states of Schmidt, "Application of state-space methods to
//! navigation problems" (Advances in Control Systems 3, 1966), in the form for batch least squares of Jazwinski, "Stochastic processes
//! and filtering theory" (1970), chapter 8. An error `p` of covariance `P_c` that changes the whitened residuals of a link by
//! `B p` moves the solution by `S p` with `S = -H^-1 sum A' B` (`A` the rows of the link, `H` the Hessian), so that
//! `P = P_noise + S P_c S'`. Considered are:
//!
//! - the sensitivity of the accelerometer, a factor on each axis: constant, independent, with the standard deviation
//!   [`SENSITIVITY`];
//! - the random walk of both biases, of the densities that the rig states. The estimate is compared with the biases at the newest
//!   key frame: those are the ones that are used from there on. A step that the bias makes within link `j` was not yet in the
//!   readings of the links up to `j`.

use super::chain::{Chain, SHARED, Shared};
use super::problem::{BIAS, Problem, State};
use crate::{Bias, Preintegrated};
use cairn_geometry::{Mat3, So3, Vec3};
use nalgebra::SMatrix;

/// Standard deviation of the sensitivity of an accelerometer's axis, relative: the tolerance that data sheets of consumer sensors
/// state for the part as delivered (ICM-20948, DS-000189 revision 1.3, table 2: 0.5 %).
const SENSITIVITY: f64 = 0.005;

/// Their part of the covariance of the shared unknowns; `chain` is the problem at `state`. `None` when it is singular.
pub fn covariance(problem: &Problem, state: &State, chain: &Chain) -> Option<Shared> {
    let influence = Influence::of(problem, state, chain)?;
    let mut covariance = influence.sensitivity * influence.sensitivity.transpose() * SENSITIVITY.powi(2);
    for (link, by_step) in problem.links.iter().zip(&influence.steps) {
        let noise = link.sum().noise();
        for (first, density) in [(0, noise.gyro_walk), (3, noise.accel_walk)] {
            let by_step = by_step.fixed_columns::<3>(first);
            covariance += by_step * by_step.transpose() * (density.powi(2) * link.sum().seconds());
        }
    }
    Some(covariance)
}

/// What the errors do to the shared unknowns: estimate less truth by each of them.
struct Influence {
    /// By the sensitivity of each axis.
    sensitivity: SMatrix<f64, SHARED, 3>,
    /// By the step of the biases (gyro, accel) within each link.
    steps: Vec<SMatrix<f64, SHARED, 6>>,
}

impl Influence {
    fn of(problem: &Problem, state: &State, chain: &Chain) -> Option<Self> {
        let (states, shared) = chain.shared_columns()?;
        let mut sensitivity = SMatrix::zeros();
        let mut earlier = SMatrix::<f64, SHARED, 6>::zeros();
        let mut steps = Vec::with_capacity(problem.links.len());
        for (k, link) in problem.links.iter().enumerate() {
            let rows = problem.rows(state, k)?;
            let moved = rows.by_first * states[k] + rows.by_second * states[k + 1] + rows.by_shared * shared;
            let by_residual = -moved.transpose();
            sensitivity += by_residual * rows.white * residual_by_sensitivity(link.sum(), &state.bias);
            earlier += by_residual * rows.by_shared.fixed_columns::<6>(BIAS);
            steps.push(earlier);
        }
        Some(Self { sensitivity, steps })
    }
}

/// The residual of a link (rotation, velocity, position) by the sensitivity of the accelerometer's axes, integrated as the readings
/// are (`Preintegrated`).
fn residual_by_sensitivity(link: &Preintegrated, bias: &Bias) -> SMatrix<f64, 9, 3> {
    let (mut rotation, mut velocity, mut position) = (So3::identity(), Mat3::zeros(), Mat3::zeros());
    for pair in link.samples().windows(2) {
        let dt = pair[1].stamp - pair[0].stamp;
        let next = rotation * So3::exp(&(((pair[0].gyro + pair[1].gyro) * 0.5 - bias.gyro) * dt));
        let of =
            |rotation: &So3, reading: &Vec3| rotation.matrix() * Mat3::from_diagonal(&(reading - bias.accel));
        let acceleration = (of(&rotation, &pair[0].accel) + of(&next, &pair[1].accel)) * 0.5;
        position += velocity * dt + acceleration * (0.5 * dt * dt);
        velocity += acceleration * dt;
        rotation = next;
    }
    let mut by = SMatrix::<f64, 9, 3>::zeros();
    by.fixed_view_mut::<3, 3>(3, 0).copy_from(&-velocity);
    by.fixed_view_mut::<3, 3>(6, 0).copy_from(&-position);
    by
}

#[cfg(test)]
mod tests {
    use super::super::map::descend;
    use super::*;
    use crate::initialise::{InitialiseConfig, Scale, Seen, SeenPose};
    use crate::{Gravity, NavState};
    use cairn_geometry::{Manifold, Se3};
    use cairn_sensor::{GRAVITY_M_S2, ImuNoise, ImuSample, Stamp};
    use cairn_solve::to_end;
    use nalgebra::SVector;
    use std::ops::SubAssign;

    const NOISE: ImuNoise = ImuNoise { gyro: 2e-4, gyro_walk: 2e-5, accel: 2e-3, accel_walk: 3e-3 };
    const KEY_FRAMES: usize = 13;
    const STEP_S: f64 = 0.25;

    fn pose(t: f64) -> Se3 {
        let rotation = So3::exp(&Vec3::new(0.6 * (1.7 * t).sin(), 0.3 * t, 0.5 * (1.1 * t).cos()));
        Se3::new(rotation, Vec3::new((1.9 * t).sin(), 0.7 * (2.3 * t).cos(), 0.4 * (3.1 * t).sin()))
    }

    fn reading(t: f64) -> ImuSample {
        let (h, place) = (1e-3, |t| pose(t).translation);
        let acceleration = (place(t + h) - place(t) * 2.0 + place(t - h)) / (h * h);
        let rotation = pose(t).rotation;
        let gyro = (pose(t - h).rotation.inverse() * pose(t + h).rotation).log() / (2.0 * h);
        let accel = rotation.inverse() * (acceleration + Vec3::z() * GRAVITY_M_S2);
        ImuSample::new(Stamp::from_seconds(t), gyro, accel)
    }

    /// The solution with exact poses and readings that are changed by link: the shared unknowns, and what errors do to them.
    fn solved(changed: impl Fn(usize, &mut ImuSample)) -> (State, Influence) {
        let link = |k: usize| {
            let mut samples: Vec<ImuSample> =
                (0..=50).map(|i| reading(STEP_S * (k as f64 + f64::from(i) / 50.0))).collect();
            samples.iter_mut().for_each(|s| changed(k, s));
            Preintegrated::of(NOISE, Bias::default(), samples)
        };
        let stamp = |k: usize| STEP_S * k as f64;
        let seen_pose =
            |k| SeenPose { stamp: Stamp::from_seconds(stamp(k)), world_from_camera: pose(stamp(k)) };
        let poses: Vec<SeenPose> = (0..KEY_FRAMES).map(seen_pose).collect();
        let seen = Seen { poses: &poses, rotation_sigma: 1e-3, position_sigma: 2e-3 };
        let config = InitialiseConfig { noise_times: 1.0, iterations: 40, ..Default::default() };
        let links: Vec<Preintegrated> = (1..KEY_FRAMES).map(|k| link(k - 1)).collect();
        let mut problem = Problem::new(&seen, &links, &Se3::identity(), Scale::Free, &config);
        let velocity = |k| (pose(stamp(k) + 1e-3).translation - pose(stamp(k) - 1e-3).translation) / 2e-3;
        let start = State {
            log_scale: 0.0,
            gravity: Gravity::level(),
            bias: Bias::default(),
            offset_s: 0.0,
            lever_arm: Vec3::zeros(),
            errors: vec![Vec3::zeros(); KEY_FRAMES],
            turns: vec![Vec3::zeros(); KEY_FRAMES],
            velocities: (0..KEY_FRAMES).map(velocity).collect(),
        };
        let (_, state) = to_end(descend(&mut problem, start)).expect("a minimum");
        let (_, chain) = problem.linearise(&state, crate::initialise::problem::NORM_SIGMA).unwrap();
        let influence = Influence::of(&problem, &state, &chain).unwrap();
        (state, influence)
    }

    /// Scale, tilt and biases of `b` less those of `a`, at their places among the shared unknowns but for gravity's norm.
    fn difference(a: &State, b: &State) -> SVector<f64, 9> {
        let tilt = a.gravity.local(&b.gravity);
        let at = |bias| NavState { bias, ..NavState::identity() };
        let bias = at(a.bias).local(&at(b.bias)).fixed_rows::<6>(9).into_owned();
        let mut d = SVector::<f64, 9>::zeros();
        d[0] = b.log_scale - a.log_scale;
        d.fixed_rows_mut::<2>(1).copy_from(&tilt);
        d.fixed_rows_mut::<6>(3).copy_from(&bias);
        d
    }

    fn kept<const N: usize>(by: &SMatrix<f64, SHARED, N>, error: &SVector<f64, N>) -> SVector<f64, 9> {
        let all = by * error;
        SVector::from_fn(|i, _| all[if i < 3 { i } else { i + 1 }])
    }

    /// The biases move most, so that the scale is compared by itself.
    fn assert_near(found: &SVector<f64, 9>, expected: &SVector<f64, 9>, what: &str) {
        let off = (found - expected).norm() / expected.norm();
        assert!(
            off < 0.03 && (found[0] - expected[0]).abs() < 0.05 * expected[0].abs() + 1e-6,
            "{what}: {found} {expected}"
        );
    }

    #[test]
    fn sensitivity_moves_the_solution_as_predicted() {
        let (exact, influence) = solved(|_, _| {});
        for axis in 0..3 {
            let (moved, _) = solved(|_, s| s.accel[axis] *= 1.0 + 1e-3);
            let mut error = SVector::zeros();
            error[axis] = 1e-3;
            let expected = kept(&influence.sensitivity, &error);
            assert_near(&difference(&exact, &moved), &expected, &format!("axis {axis}"));
        }
    }

    #[test]
    fn a_step_of_a_bias_moves_the_solution_as_predicted() {
        let (exact, influence) = solved(|_, _| {});
        for (link, axis) in [(2, 0), (5, 1), (8, 2)] {
            for (first, size) in [(0, 1e-3), (3, 1e-2)] {
                let (moved, _) = solved(|k, s| {
                    if k > link {
                        let reading = if first == 0 { &mut s.gyro } else { &mut s.accel };
                        reading[axis] += size;
                    }
                });
                let mut step = SVector::<f64, 6>::zeros();
                step[first + axis] = size;
                // The estimate is compared with the bias at the end.
                let mut found = difference(&exact, &moved);
                found.fixed_rows_mut::<6>(3).sub_assign(&step);
                let expected = kept(&influence.steps[link], &step);
                assert_near(&found, &expected, &format!("link {link}, axis {axis}, {first}"));
            }
        }
    }
}
