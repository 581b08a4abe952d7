//! The first guess: velocity, gravity and points from linear equations, the biases taken as zero. A point lies on each ray that shows it,
//! whose direction the gyroscope gives and whose origin is linear in velocity and gravity.

use super::problem::{Problem, State};
use crate::{Bias, Gravity};
use cairn_geometry::{Mat3, Vec3};
use cairn_sensor::GRAVITY_M_S2;
use nalgebra::{SMatrix, SVector};

/// Rounds: in each, rays are weighed by the depths that the one before has found.
const ROUNDS: usize = 4;
/// The depth of everything before that, metres.
const DEPTH_M: f64 = 3.0;
/// Standard deviation of the mean acceleration of one who walks, over the frames, m/s^2.
const PUSHED_M_S2: f64 = 0.5;
/// Of the velocity, m/s.
const SPEED_M_S: f64 = 3.0;
/// Rays farther off than so many standard deviations count less.
const FAR: f64 = 3.0;
/// Depths that are believed, metres.
const DEPTHS_M: [f64; 2] = [0.1, 50.0];

type Six = SVector<f64, 6>;

/// Velocity and gravity that most rays agree with.
pub fn guess(problem: &Problem) -> Option<State> {
    let sums = &problem.sums;
    let camera = &problem.of.imu_from_camera;
    let bias = Bias::default();
    let frames: Vec<(f64, Mat3, Vec3)> = sums
        .iter()
        .map(|sum| {
            let (rotation, _, place) = sum.gained(&bias);
            (sum.seconds(), (rotation * camera.rotation).matrix(), place + rotation * camera.translation)
        })
        .collect();
    let last = sums.last()?;
    // At an even pace the mean force is that which holds against gravity.
    let (_, gained, _) = last.gained(&bias);
    let down = -gained / last.seconds();
    let down = down.try_normalize(1e-6)? * GRAVITY_M_S2;
    let mut depths = vec![DEPTH_M; problem.of.tracks.len()];
    let mut weights = vec![1.0; depths.len()];
    let mut found = Six::zeros();
    for _ in 0..ROUNDS {
        let mut h = SMatrix::<f64, 6, 6>::zeros();
        let mut g = Six::zeros();
        for i in 0..3 {
            h[(i, i)] = SPEED_M_S.powi(-2);
            h[(3 + i, 3 + i)] = PUSHED_M_S2.powi(-2);
            g[3 + i] = down[i] * PUSHED_M_S2.powi(-2);
        }
        let mut eliminated = Vec::with_capacity(depths.len());
        for ((track, depth), weight) in problem.of.tracks.iter().zip(&depths).zip(&weights) {
            let mut own = Mat3::identity() * 1e-6;
            let (mut coupled, mut right) = (SMatrix::<f64, 3, 6>::zeros(), Vec3::zeros());
            let (mut h_own, mut g_own) = (SMatrix::<f64, 6, 6>::zeros(), Six::zeros());
            for p in track {
                let (t, rotation, place) = &frames[p.frame];
                let d = (rotation * Vec3::new(p.ray[0], p.ray[1], 1.0)).normalize();
                // Across the ray; a position `x v + y g + place` is subtracted from the point.
                let across = (Mat3::identity() - d * d.transpose())
                    * (weight / (depth * problem.of.priors.ray).powi(2));
                let mut by = SMatrix::<f64, 3, 6>::zeros();
                by.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Mat3::identity() * *t));
                by.fixed_view_mut::<3, 3>(0, 3).copy_from(&(Mat3::identity() * (0.5 * t * t)));
                own += across;
                coupled -= across * by;
                right += across * place;
                h_own += by.transpose() * across * by;
                g_own -= by.transpose() * across * place;
            }
            let inverse = own.try_inverse()?;
            h += h_own - coupled.transpose() * inverse * coupled;
            g += g_own - coupled.transpose() * inverse * right;
            eliminated.push((inverse, coupled, right));
        }
        found = h.cholesky()?.solve(&g);
        for (i, (inverse, coupled, right)) in eliminated.iter().enumerate() {
            let point = inverse * (right - coupled * found);
            let track = &problem.of.tracks[i];
            let at = |k: usize| {
                let (t, rotation, place) = &frames[k];
                let (v, down) = (found.fixed_rows::<3>(0), found.fixed_rows::<3>(3));
                rotation.transpose() * (point - place - v * *t - down * (0.5 * t * t))
            };
            let worst = track.iter().map(|p| {
                let q = at(p.frame);
                let off = (q.x / q.z - p.ray[0]).hypot(q.y / q.z - p.ray[1]) / problem.of.priors.ray;
                if q.z > 0.0 { off } else { f64::INFINITY }
            });
            let worst = worst.fold(0.0, f64::max);
            let depth = at(track[0].frame).z;
            depths[i] = if depth > 0.0 { depth.clamp(DEPTHS_M[0], DEPTHS_M[1]) } else { DEPTHS_M[1] };
            weights[i] = if worst.is_finite() { 1.0 / (1.0 + (worst / FAR).powi(2)) } else { 0.05 };
        }
    }
    let velocity: Vec3 = found.fixed_rows::<3>(0).into();
    let gravity: Vec3 = found.fixed_rows::<3>(3).into();
    Some(State {
        velocity,
        gravity: Gravity::along(&gravity, GRAVITY_M_S2)?,
        bias,
        offset_s: 0.0,
        log_focal: 0.0,
        readout_s: 0.0,
        inverse_depths: depths.iter().map(|depth| 1.0 / depth).collect(),
    })
}
