//! P3P: camera poses from three points and their bearings.
//!
//! Grunert's equations as given by Haralick, Lee, Ottenberg, Nolle, "Review and analysis of solutions of the three
//! point perspective pose estimation problem" (1994), section 3: a quartic for the ratio of two distances; the
//! distances are then polished by Newton's method on the three laws of cosines.

use crate::roots::real_roots;
use cairn_geometry::{Mat3, Se3, So3, Vec3};

/// Calls `visit` with each of the at most four poses `camera_from_world` that map three world points onto three unit
/// bearings, in front of the camera. No pose for collinear points.
pub fn p3p(points: &[Vec3; 3], bearings: &[Vec3; 3], mut visit: impl FnMut(Se3)) {
    let [p1, p2, p3] = points;
    let (a2, b2, c2) = ((p2 - p3).norm_squared(), (p1 - p3).norm_squared(), (p1 - p2).norm_squared());
    let [f1, f2, f3] = bearings;
    let cosines = [f2.dot(f3), f1.dot(f3), f1.dot(f2)];
    let Some(world_triad) = triad(points) else { return };
    for &v in real_roots(&quartic(a2, b2, c2, cosines)).as_slice() {
        let Some(distances) = distances(v, a2, b2, c2, cosines) else { continue };
        let in_camera: [Vec3; 3] = std::array::from_fn(|k| bearings[k] * distances[k]);
        let Some(camera_triad) = triad(&in_camera) else { continue };
        let rotation = So3::from_matrix(&(camera_triad * world_triad.transpose()));
        // The translation maps one centroid onto the other.
        let centre = (p1 + p2 + p3) / 3.0;
        let pose = Se3::new(rotation, (in_camera[0] + in_camera[1] + in_camera[2]) / 3.0 - rotation * centre);
        if pose.is_finite() {
            visit(pose);
        }
    }
}

/// The quartic in v = s3 / s1, rising powers (Haralick et al., equation 9), where s are the distances to the points.
fn quartic(a2: f64, b2: f64, c2: f64, [alpha, beta, gamma]: [f64; 3]) -> [f64; 5] {
    let (p, q) = ((a2 - c2) / b2, (a2 + c2) / b2);
    let (alpha2, gamma2) = (alpha * alpha, gamma * gamma);
    [
        (1.0 + p).powi(2) - 4.0 * a2 / b2 * gamma2,
        4.0 * (-p * (1.0 + p) * beta + 2.0 * a2 / b2 * gamma2 * beta - (1.0 - q) * alpha * gamma),
        2.0 * (p * p - 1.0 + 2.0 * p * p * beta * beta + 2.0 * (b2 - c2) / b2 * alpha2
            - 4.0 * q * alpha * beta * gamma
            + 2.0 * (b2 - a2) / b2 * gamma2),
        4.0 * (p * (1.0 - p) * beta - (1.0 - q) * alpha * gamma + 2.0 * c2 / b2 * alpha2 * beta),
        (p - 1.0).powi(2) - 4.0 * c2 / b2 * alpha2,
    ]
}

/// Distances of the three points for a root of the quartic; `None` when the root is not a solution in front of the
/// camera.
fn distances(v: f64, a2: f64, b2: f64, c2: f64, cosines: [f64; 3]) -> Option<[f64; 3]> {
    let [alpha, beta, gamma] = cosines;
    if !(v > 0.0) {
        return None;
    }
    let p = (a2 - c2) / b2;
    let s1 = (b2 / (1.0 + v * v - 2.0 * v * beta)).sqrt();
    let below = 2.0 * (gamma - v * alpha);
    let u = if below.abs() > 1e-6 {
        ((p - 1.0) * v * v - 2.0 * p * beta * v + 1.0 + p) / below
    } else {
        // The law of cosines for s1 and s2 alone; of its two solutions the one that fits s2 and s3.
        let root = (gamma * gamma - 1.0 + c2 / (s1 * s1)).max(0.0).sqrt();
        let misfit = |u: f64| (u * u + v * v - 2.0 * u * v * alpha - a2 / (s1 * s1)).abs();
        let (plus, minus) = (gamma + root, gamma - root);
        if misfit(plus) < misfit(minus) { plus } else { minus }
    };
    let mut s = Vec3::new(s1, u * s1, v * s1);
    for _ in 0..4 {
        let f = Vec3::new(
            s.y * s.y + s.z * s.z - 2.0 * s.y * s.z * alpha - a2,
            s.x * s.x + s.z * s.z - 2.0 * s.x * s.z * beta - b2,
            s.x * s.x + s.y * s.y - 2.0 * s.x * s.y * gamma - c2,
        );
        let j = Mat3::new(
            0.0,
            s.y - s.z * alpha,
            s.z - s.y * alpha,
            s.x - s.z * beta,
            0.0,
            s.z - s.x * beta,
            s.x - s.y * gamma,
            s.y - s.x * gamma,
            0.0,
        ) * 2.0;
        let Some(step) = j.try_inverse().map(|i| i * f) else { break };
        s -= step;
        if f.amax() < 1e-13 * (a2 + b2 + c2) {
            break;
        }
    }
    let residual = [
        s.y * s.y + s.z * s.z - 2.0 * s.y * s.z * alpha - a2,
        s.x * s.x + s.z * s.z - 2.0 * s.x * s.z * beta - b2,
        s.x * s.x + s.y * s.y - 2.0 * s.x * s.y * gamma - c2,
    ];
    let good = s.iter().all(|d| *d > 0.0) && residual.iter().all(|r| r.abs() < 1e-6 * (a2 + b2 + c2));
    good.then(|| s.into())
}

/// An orthonormal frame of three points; `None` when they are collinear.
fn triad(p: &[Vec3; 3]) -> Option<Mat3> {
    let (a, b) = (p[1] - p[0], p[2] - p[0]);
    let normal = a.cross(&b);
    if !(normal.norm() > 1e-7 * a.norm() * b.norm()) {
        return None;
    }
    let (x, z) = (a.normalize(), normal.normalize());
    Some(Mat3::from_columns(&[x, z.cross(&x), z]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    #[test]
    fn true_pose_is_among_the_solutions() {
        let mut rng = Random::new(41);
        let mut missed = 0;
        for trial in 0..2000 {
            let v = |rng: &mut Random, s: f64| {
                Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s
            };
            let turn = v(&mut rng, 1.0);
            let truth = Se3::new(So3::exp(&turn), v(&mut rng, 3.0));
            let in_camera: [Vec3; 3] = std::array::from_fn(|_| {
                // Every other set at a single depth, which makes the distances nearly equal.
                let z = if trial % 2 == 0 { rng.uniform(1.0, 8.0) } else { 4.0 };
                Vec3::new(rng.uniform(-0.7, 0.7), rng.uniform(-0.5, 0.5), 1.0) * z
            });
            let points = in_camera.map(|p| truth.inverse() * p);
            let mut best = f64::INFINITY;
            p3p(&points, &in_camera.map(|p| p.normalize()), |pose| {
                for (p, s) in points.iter().zip(&in_camera) {
                    assert!((pose * *p).normalize().cross(&s.normalize()).norm() < 1e-4);
                }
                let error = pose.inverse() * truth;
                best = best.min(error.rotation.angle() + error.translation.norm());
            });
            if best > 1e-4 {
                missed += 1;
            }
        }
        println!("{missed} of 2000 missed");
        assert!(missed <= 10, "{missed}");
    }

    #[test]
    fn degenerate_points_give_no_pose() {
        let line = [Vec3::new(0.0, 0.0, 1.0), Vec3::new(1.0, 0.0, 1.0), Vec3::new(2.0, 0.0, 1.0)];
        p3p(&line, &line.map(|p| p.normalize()), |_| panic!("a pose from collinear points"));
        p3p(&[Vec3::zeros(); 3], &[Vec3::z(); 3], |_| panic!("a pose from coincident points"));
        p3p(&[Vec3::repeat(f64::NAN); 3], &[Vec3::z(); 3], |_| panic!("a pose from NaN"));
    }
}
