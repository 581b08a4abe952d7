//! First guesses: the gyroscope's bias from rotations alone, then scale, gravity and velocity from linear equations.
//!
//! Source: Mur-Artal & Tardós (RA-L 2017), section IV: A by iteration on the rotations, B and C as one linear system. The
//! velocities are not unknowns here: with the visual rotations, the position at each key frame is linear in the first
//! position and velocity, gravity, scale and the accelerometer's bias.

use super::link::Link;
use super::problem::Problem;
use crate::{Bias, Gravity};
use cairn_geometry::{Manifold, Mat3, So3, Vec3};
use cairn_sensor::GRAVITY_M_S2;
use nalgebra::{Cholesky, SMatrix, SVector};

/// Seconds of the sequence that the linear guess uses: over longer times the random walk of the bias and the rotation errors
/// are integrated twice.
const GUESS_S: f64 = 5.0;

/// Where the solver starts.
#[derive(Clone, Debug)]
pub struct Guess {
    pub scale: f64,
    pub gravity: Gravity,
    pub bias: Bias,
    /// At each key frame, m/s in the frame of the map.
    pub velocities: Vec<Vec3>,
}

/// The gyro bias that best explains the visual rotations.
pub fn gyro_bias(rotations: &[So3], links: &mut [Link], iterations: usize) -> Vec3 {
    let mut bias = Bias::default();
    for _ in 0..iterations {
        let (mut h, mut b) = (Mat3::identity() * 1e-12, Vec3::zeros());
        for (pair, link) in rotations.windows(2).zip(links.iter_mut()) {
            link.reintegrate(bias);
            let (turn, ..) = link.sum().gained(&bias);
            let residual = (turn.inverse() * pair[0].inverse() * pair[1]).log();
            let by_bias = -(So3::right_jacobian_inverse(&residual)
                * So3::exp(&-residual).matrix()
                * link.sum().sums().rotation_by_gyro);
            h += by_bias.transpose() * by_bias;
            b += by_bias.transpose() * residual;
        }
        let Some(step) = h.cholesky().map(|c| c.solve(&-b)) else { break };
        bias.gyro += step;
        if step.norm() < 1e-7 {
            break;
        }
    }
    links.iter_mut().for_each(|link| link.reintegrate(bias));
    bias.gyro
}

/// Dead reckoning with unknown start, gravity and bias: `place(k) = first + velocity t + gravity t^2 / 2 + integrated(k) + by_bias(k) bias`.
struct Integrated {
    seconds: f64,
    velocity: Vec3,
    place: Vec3,
    velocity_by_bias: Mat3,
    place_by_bias: Mat3,
}

fn integrated(rotations: &[So3], links: &[Link]) -> Vec<Integrated> {
    let mut out = vec![Integrated {
        seconds: 0.0,
        velocity: Vec3::zeros(),
        place: Vec3::zeros(),
        velocity_by_bias: Mat3::zeros(),
        place_by_bias: Mat3::zeros(),
    }];
    for (rotation, link) in rotations.iter().zip(links) {
        let last = &out[out.len() - 1];
        let (r, t, sums) = (rotation.matrix(), link.sum().seconds(), link.sum().sums());
        out.push(Integrated {
            seconds: last.seconds + t,
            velocity: last.velocity + r * sums.velocity,
            place: last.place + last.velocity * t + r * sums.position,
            velocity_by_bias: last.velocity_by_bias + r * sums.velocity_by_accel,
            place_by_bias: last.place_by_bias + last.velocity_by_bias * t + r * sums.position_by_accel,
        });
    }
    out
}

/// Guesses from the linear equations, gravity free and then of its known norm, and one with gravity against the mean force.
/// The gyroscope's bias must be in the links already.
pub fn guesses(problem: &Problem, gyro: Vec3) -> Vec<Guess> {
    let path = integrated(&problem.rotations, &problem.links);
    let total = &path[path.len() - 1];
    let mut out = Vec::new();
    let mut directions = Vec::new();
    if let Some(free) = linear(problem, &path, None) {
        directions.push(Vec3::from(free.fixed_rows::<3>(6)));
    }
    directions.push(-total.velocity / total.seconds);
    for direction in directions {
        let Some(mut gravity) = Gravity::along(&direction, GRAVITY_M_S2) else { continue };
        let mut solution = None;
        for _ in 0..4 {
            let Some(x) = linear(problem, &path, Some(&gravity)) else { break };
            gravity = tilted(&gravity, x[6], x[7]);
            solution = Some(x);
        }
        let Some(x) = solution else { continue };
        let (velocity, accel): (Vec3, Vec3) = (x.fixed_rows::<3>(3).into(), x.fixed_rows::<3>(10).into());
        let g = gravity.vector();
        let velocities =
            path.iter().map(|f| velocity + g * f.seconds + f.velocity + f.velocity_by_bias * accel).collect();
        let scale = if problem.scale_is_free() { x[9].abs() } else { 1.0 };
        if scale > 0.0 && scale.is_finite() {
            out.push(Guess { scale, gravity, bias: Bias { gyro, accel }, velocities });
        }
    }
    out
}

fn tilted(gravity: &Gravity, x: f64, y: f64) -> Gravity {
    // A first guess may be far off, so the solution is approached in steps.
    let norm = (x * x + y * y).sqrt();
    let part = if norm > 0.5 { 0.5 / norm } else { 1.0 };
    gravity.retract(&nalgebra::Vector2::new(x * part, y * part))
}

/// First place (3), first velocity (3), gravity (3; with `around` its tilt (2) and nothing), scale, accel bias (3).
fn linear(problem: &Problem, path: &[Integrated], around: Option<&Gravity>) -> Option<SVector<f64, 13>> {
    let mut h = SMatrix::<f64, 13, 13>::zeros();
    let mut b = SVector::<f64, 13>::zeros();
    let arm = problem.imu_from_camera.translation;
    let known = !problem.scale_is_free();
    for ((f, pose), rotation) in path.iter().zip(problem.places.iter()).zip(&problem.rotations) {
        if f.seconds > GUESS_S {
            break;
        }
        let t2 = 0.5 * f.seconds * f.seconds;
        let mut row = SMatrix::<f64, 3, 13>::zeros();
        let mut put = |column: usize, block: Mat3| row.fixed_view_mut::<3, 3>(0, column).copy_from(&block);
        put(0, Mat3::identity());
        put(3, Mat3::identity() * f.seconds);
        put(10, f.place_by_bias);
        // scale * place - R arm = first + velocity t + gravity t^2 / 2 + integrated
        let mut rhs = -(*rotation * arm) - f.place;
        match around {
            Some(g) => {
                row.fixed_view_mut::<3, 2>(0, 6).copy_from(&(g.jacobian() * t2));
                rhs -= g.vector() * t2;
            }
            None => row.fixed_view_mut::<3, 3>(0, 6).copy_from(&(Mat3::identity() * t2)),
        }
        if known {
            rhs += pose;
        } else {
            row.fixed_view_mut::<3, 1>(0, 9).copy_from(&-pose);
        }
        h += row.transpose() * row;
        b += row.transpose() * rhs;
    }
    if around.is_some() {
        h[(8, 8)] += 1.0;
    }
    if known {
        h[(9, 9)] += 1.0;
    }
    // A position is accurate to about a centimetre; the bias has its prior.
    let prior = (0.01 / problem.config.accel_bias_sigma).powi(2);
    for k in 10..13 {
        h[(k, k)] += prior;
    }
    Some(Cholesky::new(h)?.solve(&b))
}
