//! Chow test: do two groups of matches ask for the same camera pose? Each group is solved on its own by one Gauss-Newton
//! step from a pose near both solutions, and the distance between the two is compared with its covariance.
//!
//! Source: Wald's test that two samples share their parameters; Chow, "Tests of equality between sets of coefficients in
//! two linear regressions" (1960), here with known variances.

use crate::matched_points::MatchedPoints;
use crate::{Pinhole, PointMatch};
use cairn_geometry::Se3;
use nalgebra::{SMatrix, SVector};

/// Squared Mahalanobis distance between the poses that two groups of matches ask for: chi-square with six degrees of
/// freedom when the points of both groups are static and the pixel noise is that of the weights. `None` when one group
/// alone does not determine a pose.
pub fn chow_test(camera: &Pinhole, near: &Se3, one: &[PointMatch], other: &[PointMatch]) -> Option<f64> {
    let alone = |matches: &[PointMatch]| -> Option<(SVector<f64, 6>, SMatrix<f64, 6, 6>)> {
        let normal = MatchedPoints::new(matches).normal_equations(camera, near, false);
        let covariance = normal.hessian.cholesky()?.inverse();
        Some((-(covariance * normal.gradient), covariance))
    };
    let ((to_one, of_one), (to_other, of_other)) = (alone(one)?, alone(other)?);
    let apart = to_one - to_other;
    let squared = apart.dot(&(of_one + of_other).cholesky()?.solve(&apart));
    squared.is_finite().then_some(squared)
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::Vec3;

    const CAMERA: Pinhole = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };

    /// Matches of points that have moved by `moved` since they were placed; the camera is at the origin, errors are a
    /// tenth of a pixel.
    fn matches(from: usize, count: usize, moved: Vec3) -> Vec<PointMatch> {
        (from..from + count)
            .map(|i| {
                let a = i as f64;
                let point =
                    Vec3::new((a * 0.7).sin() * 2.0, (a * 1.3).cos() * 1.5, 4.0 + (a * 0.37).sin() * 2.0);
                let q = point + moved;
                let off = |k: f64| 0.1 * (a * k).sin();
                let u = CAMERA.fx * q.x / q.z + CAMERA.cx;
                let v = CAMERA.fy * q.y / q.z + CAMERA.cy;
                let right = u - CAMERA.baseline_fx / q.z;
                PointMatch { point, pixel: [u + off(7.1), v + off(9.3), right + off(4.7)], weight: 1.0 }
            })
            .collect()
    }

    #[test]
    fn accepts_static_points_and_rejects_moving_points() {
        let still = matches(0, 150, Vec3::zeros());
        let also = matches(150, 100, Vec3::zeros());
        let moved = matches(150, 100, Vec3::new(0.0, 0.0, 0.05));
        let test = |other: &[PointMatch]| chow_test(&CAMERA, &Se3::identity(), &still, other).unwrap();
        assert!(test(&also) < 12.0, "{}", test(&also));
        assert!(test(&moved) > 100.0, "{}", test(&moved));
    }

    #[test]
    fn empty_group_gives_none() {
        let still = matches(0, 150, Vec3::zeros());
        assert_eq!(chow_test(&CAMERA, &Se3::identity(), &still, &[]), None);
    }
}
