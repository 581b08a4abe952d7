//! Closed-form triangulation from two and from many views.

use cairn_geometry::{Mat3, Se3, Vec2, Vec3, hat};

/// The essential matrix of a motion: `second_ray' * E * first_ray = 0` (Longuet-Higgins 1981), `E = [t]x R`.
pub fn essential(second_from_first: &Se3) -> Mat3 {
    hat(&second_from_first.translation) * second_from_first.rotation.matrix()
}

/// Midpoint triangulation: the point, in the first camera's frame, halfway between the nearest points of two rays.
///
/// Rays are directions of any length in their own camera's frame. `None` when they are parallel up to rounding. The
/// point may lie behind the cameras.
pub fn midpoint(second_from_first: &Se3, first_ray: &Vec3, second_ray: &Vec3) -> Option<Vec3> {
    let inverse = second_from_first.rotation.inverse();
    let (a, b) = (*first_ray, inverse * *second_ray);
    let centre = -(inverse * second_from_first.translation);
    // Least squares of lambda * a - mu * b = centre.
    let (aa, ab, bb) = (a.norm_squared(), a.dot(&b), b.norm_squared());
    let determinant = aa * bb - ab * ab;
    // Also true for NaN.
    if !(determinant > 1e-14 * aa * bb) {
        return None;
    }
    let (ca, cb) = (centre.dot(&a), centre.dot(&b));
    let lambda = (bb * ca - ab * cb) / determinant;
    let mu = (ab * ca - aa * cb) / determinant;
    Some((a * lambda + centre + b * mu) * 0.5)
}

/// Moves two image points (unit focal length) by the smallest sum of squares such that their rays intersect.
///
/// Lindstrom, "Triangulation made easy" (CVPR 2010), listing 3 (two steps; the remaining error is below rounding in
/// practice).
pub fn correct(essential: &Mat3, first: &Vec2, second: &Vec2) -> [Vec2; 2] {
    // In the paper's epipolar constraint the first view is on the left; here the second is: x2' E x1 = 0.
    let (x1, x2) = (Vec3::new(first.x, first.y, 1.0), Vec3::new(second.x, second.y, 1.0));
    let e = essential.fixed_view::<2, 2>(0, 0).into_owned();
    let (line2, line1) = (essential * x1, essential.transpose() * x2);
    let (mut n2, mut n1) = (line2.xy(), line1.xy());
    let a = n2.dot(&(e * n1));
    let b = 0.5 * (n1.norm_squared() + n2.norm_squared());
    let c = x2.dot(&line2);
    let d = (b * b - a * c).max(0.0).sqrt();
    let lambda = c / (b + d);
    let (d1, d2) = (n1 * lambda, n2 * lambda);
    n2 -= e * d1;
    n1 -= e.transpose() * d2;
    let lambda = lambda * 2.0 * d / (n1.norm_squared() + n2.norm_squared());
    if !lambda.is_finite() {
        return [*first, *second];
    }
    [first - n1 * lambda, second - n2 * lambda]
}

/// The point with the smallest sum of squared distances to many rays: `views` are poses `camera_from_world` and unit
/// rays in the camera frame. `None` for fewer than two views or when all rays are parallel.
pub fn triangulate_views(views: &[(Se3, Vec3)]) -> Option<Vec3> {
    let (mut a, mut b) = (Mat3::zeros(), Vec3::zeros());
    for (camera_from_world, ray) in views {
        let inverse = camera_from_world.inverse();
        let ray = inverse.rotation * ray.normalize();
        let across = Mat3::identity() - ray * ray.transpose();
        a += across;
        b += across * inverse.translation;
    }
    // The smallest eigenvalue is about the sum of squared sines between rays.
    let determinant = a.determinant();
    let n = views.len() as f64;
    if views.len() < 2 || !(determinant > 1e-12 * n * n * n) {
        return None;
    }
    a.cholesky().map(|c| c.solve(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;
    use cairn_random::Random;

    fn motion(rng: &mut Random) -> Se3 {
        let small = |rng: &mut Random, s: f64| {
            Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s
        };
        let w = small(rng, 0.08);
        Se3::new(So3::exp(&w), small(rng, 0.4))
    }

    fn point(rng: &mut Random) -> Vec3 {
        let z = rng.uniform(2.0, 8.0);
        Vec3::new(rng.uniform(-0.5, 0.5) * z, rng.uniform(-0.4, 0.4) * z, z)
    }

    #[test]
    fn exact_without_noise() {
        let mut rng = Random::new(1);
        for _ in 0..500 {
            let (t, p) = (motion(&mut rng), point(&mut rng));
            let q = t * p;
            if q.z < 0.2 {
                continue;
            }
            assert!((midpoint(&t, &p, &q).unwrap() - p).norm() < 1e-6 * p.norm());
            let views = [(Se3::identity(), p.normalize()), (t, q.normalize())];
            if let Some(m) = triangulate_views(&views) {
                assert!((m - p).norm() < 1e-5 * p.norm());
            }
        }
    }

    #[test]
    fn correction_makes_rays_intersect_with_minimal_shift() {
        let mut rng = Random::new(2);
        let (mut cost, mut cost_midpoint) = (0.0, 0.0);
        for _ in 0..500 {
            let (t, p) = (motion(&mut rng), point(&mut rng));
            let q = t * p;
            if q.z < 0.5 {
                continue;
            }
            let noise = |rng: &mut Random| Vec2::new(rng.standard_normal(), rng.standard_normal()) / 450.0;
            let (a, b) = (p.xy() / p.z + noise(&mut rng), q.xy() / q.z + noise(&mut rng));
            let e = essential(&t);
            let [ca, cb] = correct(&e, &a, &b);
            let off = cb.push(1.0).dot(&(e * ca.push(1.0))).abs();
            assert!(off < 1e-7 * t.translation.norm(), "{off}");
            let m = midpoint(&t, &a.push(1.0), &b.push(1.0)).unwrap();
            let n = t * m;
            cost += (ca - a).norm_squared() + (cb - b).norm_squared();
            cost_midpoint += (m.xy() / m.z - a).norm_squared() + (n.xy() / n.z - b).norm_squared();
        }
        // One degree of freedom of noise per match: 500 * sigma^2 expected, and less than that of the plain midpoint.
        assert!(cost < cost_midpoint);
        assert!((cost * 450.0 * 450.0 - 500.0).abs() < 120.0, "{}", cost * 450.0 * 450.0);
    }

    #[test]
    fn one_view_and_parallel_rays_give_no_point() {
        let t = Se3::new(So3::identity(), Vec3::new(-0.3, 0.0, 0.0));
        assert!(triangulate_views(&[(Se3::identity(), Vec3::z())]).is_none());
        assert!(triangulate_views(&[(Se3::identity(), Vec3::z()), (t, Vec3::z())]).is_none());
        assert!(midpoint(&t, &Vec3::z(), &Vec3::z()).is_none());
    }
}
