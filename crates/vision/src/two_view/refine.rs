//! Nonlinear refinement of a relative motion: five unknowns, Sampson error (a first-order approximation of the
//! reprojection error).

use super::score::Match;
use crate::triangulate::essential;
use cairn_geometry::{Mat3, Se3, So3, Vec3, hat};
use cairn_solve::{Convergence, Damping, DenseNormal, LevenbergMarquardt, minimise_dense};
use nalgebra::{SMatrix, SVector};

/// Huber loss: residuals beyond this many standard deviations count linearly (Huber 1964).
const HUBER: f64 = 1.5;
/// Residuals beyond this many standard deviations have no influence.
const GATE: f64 = 2.5;
const STEPS: usize = 12;

/// Levenberg-Marquardt over rotation and direction of translation; `matches` are image points at unit focal length,
/// `sigma` their standard deviation. The result has unit translation.
pub(super) fn refine(start: &Se3, matches: &[Match], sigma: f64) -> Se3 {
    let solver = LevenbergMarquardt {
        iterations: STEPS,
        damping: Damping::Factors {
            first: 1e-6,
            least: 1e-9,
            most: 1e4,
            shrink: 0.1,
            grow: 100.0,
            restart: 1e-4,
        },
        convergence: Convergence::Actual { relative: 1e-6 },
    };
    let start = Se3::new(start.rotation, start.translation.normalize());
    let moved = |motion: &Se3, step: &SVector<f64, 5>| {
        let tangent = tangent(&motion.translation);
        let rotation = motion.rotation * So3::exp(&Vec3::new(step[0], step[1], step[2]));
        let translation = (motion.translation + tangent[0] * step[3] + tangent[1] * step[4]).normalize();
        Se3::new(rotation, translation)
    };
    minimise_dense(&solver, &start, 0.0, |motion| linearise(motion, matches, sigma), moved).0
}

/// Two orthonormal vectors perpendicular to a unit vector.
fn tangent(t: &Vec3) -> [Vec3; 2] {
    let other = if t.x.abs() < 0.6 { Vec3::x() } else { Vec3::y() };
    let a = t.cross(&other).normalize();
    [a, t.cross(&a)]
}

fn linearise(motion: &Se3, matches: &[Match], sigma: f64) -> DenseNormal<5> {
    let e = essential(motion);
    let rotation = motion.rotation.matrix();
    let [b1, b2] = tangent(&motion.translation);
    let derivatives: [Mat3; 5] = [
        e * hat(&Vec3::x()),
        e * hat(&Vec3::y()),
        e * hat(&Vec3::z()),
        hat(&b1) * rotation,
        hat(&b2) * rotation,
    ];
    let mut s = DenseNormal { hessian: SMatrix::zeros(), gradient: SVector::zeros(), cost: 0.0 };
    for &[x, y, u, v] in matches {
        let (a, b) = (Vec3::new(x, y, 1.0), Vec3::new(u, v, 1.0));
        let (line2, line1) = (e * a, e.tr_mul(&b));
        let square = line2.xy().norm_squared() + line1.xy().norm_squared();
        let root = square.sqrt() * sigma;
        let algebraic = b.dot(&line2);
        let r = algebraic / root;
        // Also skips NaN.
        if !(r.abs() < GATE) {
            s.cost += 0.5 * HUBER * (2.0 * GATE - HUBER);
            continue;
        }
        let weight = if r.abs() <= HUBER { 1.0 } else { HUBER / r.abs() };
        s.cost += 0.5 * if r.abs() <= HUBER { r * r } else { HUBER * (2.0 * r.abs() - HUBER) };
        let mut j = SVector::<f64, 5>::zeros();
        for (k, d) in derivatives.iter().enumerate() {
            let (d2, d1) = (d * a, d.tr_mul(&b));
            let d_square = line2.xy().dot(&d2.xy()) + line1.xy().dot(&d1.xy());
            j[k] = b.dot(&d2) / root - r * d_square / square;
        }
        s.hessian += j * j.transpose() * weight;
        s.gradient += j * (weight * r);
    }
    s
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    #[test]
    fn gradient_matches_the_cost() {
        let mut rng = Random::new(31);
        let t = Se3::new(So3::exp(&Vec3::new(0.05, -0.1, 0.02)), Vec3::new(0.8, 0.1, -0.3).normalize());
        let matches: Vec<Match> = (0..40)
            .map(|_| {
                let p = Vec3::new(rng.uniform(-2.0, 2.0), rng.uniform(-2.0, 2.0), rng.uniform(3.0, 8.0));
                let q = t * p;
                let n = || 0.001;
                [
                    p.x / p.z + n() * rng.standard_normal(),
                    p.y / p.z,
                    q.x / q.z,
                    q.y / q.z + n() * rng.standard_normal(),
                ]
            })
            .collect();
        let s = linearise(&t, &matches, 0.002);
        let [b1, b2] = tangent(&t.translation);
        for k in 0..5 {
            let moved = |h: f64| {
                let mut w = Vec3::zeros();
                let mut d = Vec3::zeros();
                match k {
                    0..3 => w[k] = h,
                    3 => d = b1 * h,
                    _ => d = b2 * h,
                }
                let m = Se3::new(t.rotation * So3::exp(&w), (t.translation + d).normalize());
                linearise(&m, &matches, 0.002).cost
            };
            let numeric = (moved(1e-6) - moved(-1e-6)) / 2e-6;
            assert!(
                (numeric - s.gradient[k]).abs() < 1e-4 * numeric.abs().max(10.0),
                "{k}: {numeric} {}",
                s.gradient[k]
            );
        }
    }
}
