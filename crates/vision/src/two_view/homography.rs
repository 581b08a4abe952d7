//! Homographies: estimation from four points, and decomposition into motions.

use crate::roots::null_space;
use cairn_geometry::{Mat3, Se3, So3, Vec2, Vec3};

/// The homography of four point pairs, `second ~ H * first`, by the normalised direct linear transform (Hartley and
/// Zisserman 2004, algorithm 4.2); `None` when three points are (nearly) collinear.
pub fn four_point(first: &[Vec2; 4], second: &[Vec2; 4]) -> Option<Mat3> {
    let (t1, t2) = (normalisation(first)?, normalisation(second)?);
    let mut rows = [[0.0; 9]; 8];
    for k in 0..4 {
        let a = t1 * first[k].push(1.0);
        let b = t2 * second[k].push(1.0);
        let (x, y, u, v) = (a.x, a.y, b.x, b.y);
        rows[2 * k] = [-x, -y, -1.0, 0.0, 0.0, 0.0, u * x, u * y, u];
        rows[2 * k + 1] = [0.0, 0.0, 0.0, -x, -y, -1.0, v * x, v * y, v];
    }
    let [h] = null_space::<8, 9, 1>(rows)?;
    let h = Mat3::from_row_slice(&h);
    // Three collinear points make it singular.
    if h.determinant().abs() < 1e-6 {
        return None;
    }
    Some(t2.try_inverse()? * h * t1)
}

/// Similarity that moves the centroid to the origin and scales the mean distance from it to the square root of two.
fn normalisation(points: &[Vec2; 4]) -> Option<Mat3> {
    let centre = points.iter().sum::<Vec2>() / 4.0;
    let spread = points.iter().map(|p| (p - centre).norm()).sum::<f64>() / 4.0;
    let s = std::f64::consts::SQRT_2 / spread;
    s.is_finite().then(|| Mat3::new(s, 0.0, -s * centre.x, 0.0, s, -s * centre.y, 0.0, 0.0, 1.0))
}

/// The four motions `second_from_first` (unit translation) that are consistent with a homography of image points at
/// unit focal length, with the camera on the same side of the plane in both views; `None` for a homography without
/// parallax.
///
/// Faugeras and Lustman, "Motion and structure from motion in a piecewise planar environment" (1988), the case d' = d2.
pub fn motions(h: &Mat3) -> Option<[Se3; 4]> {
    // The determinant is positive when the camera does not cross the plane, so U * V' is a rotation.
    let svd = (h * h.determinant().signum()).svd(true, true);
    let (u, vt) = (svd.u?, svd.v_t?);
    let (d1, d2, d3) = (svd.singular_values[0], svd.singular_values[1], svd.singular_values[2]);
    if !(d2 > 0.0 && d3 > 0.0) || d1 / d2 < 1.0 + 1e-5 && d2 / d3 < 1.0 + 1e-5 {
        return None;
    }
    let total = d1 * d1 - d3 * d3;
    let x1 = ((d1 * d1 - d2 * d2) / total).max(0.0).sqrt();
    let x3 = ((d2 * d2 - d3 * d3) / total).max(0.0).sqrt();
    let cosine = (d2 * d2 + d1 * d3) / ((d1 + d3) * d2);
    let sine = x1 * x3 * (d1 * d1 - d3 * d3) / ((d1 + d3) * d2);
    let make = |e1: f64, e3: f64| {
        let s = e1 * e3 * sine;
        let turn = Mat3::new(cosine, 0.0, -s, 0.0, 1.0, 0.0, s, 0.0, cosine);
        let rotation = u * turn * vt;
        let translation = u * Vec3::new(e1 * x1, 0.0, -e3 * x3);
        Se3::new(So3::from_matrix(&rotation), translation.normalize())
    };
    Some([make(1.0, 1.0), make(1.0, -1.0), make(-1.0, 1.0), make(-1.0, -1.0)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    #[test]
    fn homography_of_a_plane_gives_the_motion() {
        let mut rng = Random::new(21);
        for _ in 0..300 {
            let v = |rng: &mut Random, s: f64| {
                Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s
            };
            let w = v(&mut rng, 0.15);
            let t = Se3::new(So3::exp(&w), v(&mut rng, 0.3));
            let normal = (Vec3::z() + v(&mut rng, 0.3)).normalize();
            let distance = 4.0;
            let truth = t.rotation.matrix() + t.translation * normal.transpose() / distance;
            if truth.determinant() < 0.2 {
                continue;
            }
            let first: [Vec2; 4] =
                std::array::from_fn(|_| Vec2::new(rng.uniform(-0.6, 0.6), rng.uniform(-0.6, 0.6)));
            let second = first.map(|p| {
                let q = truth * p.push(1.0);
                q.xy() / q.z
            });
            let Some(h) = four_point(&first, &second) else { continue };
            let scaled = h * (truth[(2, 2)] / h[(2, 2)]);
            assert!((scaled - truth).norm() < 1e-4, "{scaled} {truth}");
            let direction = t.translation.normalize();
            let best = motions(&truth)
                .unwrap()
                .iter()
                .map(|m| (m.translation - direction).norm() + (m.rotation.inverse() * t.rotation).angle())
                .fold(f64::INFINITY, f64::min);
            assert!(best < 1e-6, "{best}");
        }
    }

    #[test]
    fn degenerate_points_give_no_homography() {
        let line: [Vec2; 4] = std::array::from_fn(|k| Vec2::new(k as f64, 2.0 * k as f64));
        assert!(four_point(&line, &line).is_none());
        assert!(four_point(&[Vec2::zeros(); 4], &line).is_none());
        assert!(motions(&Mat3::identity()).is_none());
        assert!(motions(&Mat3::zeros()).is_none());
        assert!(motions(&So3::exp(&Vec3::new(0.1, 0.2, 0.0)).matrix()).is_none());
    }
}
