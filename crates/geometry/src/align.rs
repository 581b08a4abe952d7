//! Least-squares alignment of two point sets by a rigid or a similarity transform.
//!
//! Source: Umeyama, "Least-squares estimation of transformation parameters between two point patterns",
//! IEEE PAMI 13(4), 1991, equations 34-43. Input: point pairs in metres. Output: `target_from_source`, or
//! the reason why the pairs do not determine it.

use crate::{Mat3, Sim3, So3, Vec3};
use std::fmt;

/// Why point pairs do not determine an alignment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Degenerate {
    /// The two lists differ in length.
    Unpaired {
        /// Points in the target.
        target: usize,
        /// Points in the source.
        source: usize,
    },
    /// Fewer than three pairs.
    TooFew {
        /// Pairs given.
        pairs: usize,
        /// Pairs needed.
        need: usize,
    },
    /// The points of one set are collinear or coincident, so that a rotation is undetermined.
    Collinear {
        /// Ratio of the second to the first singular value of the cross-covariance.
        ratio: f64,
    },
    /// A coordinate is NaN or infinite.
    NotFinite,
}

impl fmt::Display for Degenerate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unpaired { target, source } => {
                write!(f, "{target} target points but {source} source points")
            }
            Self::TooFew { pairs, need } => write!(f, "only {pairs} point pairs, {need} are needed"),
            Self::Collinear { ratio } => write!(
                f,
                "the points are collinear or coincident (singular value ratio {ratio:.1e}), so the rotation is not \
                 determined"
            ),
            Self::NotFinite => write!(f, "a coordinate is NaN or infinite"),
        }
    }
}

impl std::error::Error for Degenerate {}

/// Ratio of the second to the first singular value below which the points are treated as collinear: a lateral spread of
/// about a millionth of the length, far below any measurement accuracy.
const COLLINEAR_RATIO: f64 = 1e-12;

/// The transform `target_from_source` that minimises the sum of squared distances over all pairs.
///
/// With `with_scale` a similarity (Umeyama eq. 42), otherwise the scale is exactly 1. At least three pairs that are not
/// collinear are needed; planar sets are sufficient.
///
/// # Errors
/// When the lists differ in length, there are fewer than three pairs, a coordinate is not finite, or the points are
/// collinear.
pub fn umeyama(target: &[Vec3], source: &[Vec3], with_scale: bool) -> Result<Sim3, Degenerate> {
    if target.len() != source.len() {
        return Err(Degenerate::Unpaired { target: target.len(), source: source.len() });
    }
    if target.len() < 3 {
        return Err(Degenerate::TooFew { pairs: target.len(), need: 3 });
    }
    if target.iter().chain(source).any(|p| !p.iter().all(|v| v.is_finite())) {
        return Err(Degenerate::NotFinite);
    }
    let n = target.len() as f64;
    let mean_target = target.iter().sum::<Vec3>() / n;
    let mean_source = source.iter().sum::<Vec3>() / n;
    let mut covariance = Mat3::zeros();
    let mut variance_source = 0.0;
    for (t, s) in target.iter().zip(source) {
        let centred = s - mean_source;
        covariance += (t - mean_target) * centred.transpose();
        variance_source += centred.norm_squared();
    }
    let (u, d, v) = singular_values(&(covariance / n));
    let ratio = if d.x > 0.0 { d.y / d.x } else { 0.0 };
    if !ratio.is_finite() || ratio < COLLINEAR_RATIO {
        return Err(Degenerate::Collinear { ratio });
    }
    // Umeyama eq. 39 and 40: a reflection is corrected along the direction of the smallest singular value.
    let sign = Vec3::new(1.0, 1.0, (u.determinant() * v.determinant()).signum());
    let rotation = So3::from_matrix(&(u * Mat3::from_diagonal(&sign) * v.transpose()));
    let scale = if with_scale { d.dot(&sign) / (variance_source / n) } else { 1.0 };
    if !(scale.is_finite() && scale > 0.0) {
        return Err(Degenerate::Collinear { ratio });
    }
    Ok(Sim3::new(rotation, mean_target - (rotation * mean_source) * scale, scale))
}

/// Singular value decomposition `m = u * diag(d) * v^T`, values in descending order, by one-sided Jacobi rotations
/// (Hestenes 1958): small values keep their relative accuracy, which forming `m^T m` would lose.
fn singular_values(m: &Mat3) -> (Mat3, Vec3, Mat3) {
    let (mut a, mut v) = (*m, Mat3::identity());
    for _sweep in 0..60 {
        let mut rotated = false;
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let (x, y) = (a.column(p).into_owned(), a.column(q).into_owned());
            let (alpha, beta, gamma) = (x.norm_squared(), y.norm_squared(), x.dot(&y));
            if gamma.abs() <= f64::EPSILON * (alpha * beta).sqrt() {
                continue;
            }
            rotated = true;
            let zeta = (beta - alpha) / (2.0 * gamma);
            let t = zeta.signum() / (zeta.abs() + zeta.hypot(1.0));
            let c = 1.0 / t.hypot(1.0);
            let s = c * t;
            for matrix in [&mut a, &mut v] {
                let (x, y) = (matrix.column(p).into_owned(), matrix.column(q).into_owned());
                matrix.set_column(p, &(x * c - y * s));
                matrix.set_column(q, &(x * s + y * c));
            }
        }
        if !rotated {
            break;
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|i, j| a.column(*j).norm().total_cmp(&a.column(*i).norm()));
    let columns = |m: &Mat3| Mat3::from_columns(&order.map(|i| m.column(i).into_owned()));
    let (a, v) = (columns(&a), columns(&v));
    let d = Vec3::new(a.column(0).norm(), a.column(1).norm(), a.column(2).norm());
    let u0: Vec3 = if d.x > 0.0 { a.column(0) / d.x } else { Vec3::x() };
    let u1: Vec3 = if d.y > 0.0 { a.column(1) / d.y } else { any_perpendicular(&u0) };
    // The third direction is determined up to its sign; the cross product is exact even where the third singular value
    // is zero (planar points).
    let u2 = u0.cross(&u1);
    let u2 = if a.column(2).dot(&u2) < 0.0 { -u2 } else { u2 };
    (Mat3::from_columns(&[u0, u1, u2]), d, v)
}

fn any_perpendicular(v: &Vec3) -> Vec3 {
    let other = if v.x.abs() < 0.9 { Vec3::x() } else { Vec3::y() };
    v.cross(&other).normalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_random::Random;

    /// A pseudo-random point cloud with the given extent.
    fn cloud(n: usize, seed: u64, spread: Vec3) -> Vec<Vec3> {
        let mut random = Random::new(seed);
        let mut next = move || random.uniform(-0.5, 0.5);
        (0..n).map(|_| Vec3::new(next(), next(), next()).component_mul(&spread)).collect()
    }

    fn known(scale: f64) -> Sim3 {
        Sim3::new(So3::exp(&Vec3::new(0.4, -1.9, 2.1)), Vec3::new(120.0, -7.0, 3.5), scale)
    }

    #[test]
    fn recovers_a_known_similarity() {
        for (seed, spread) in [
            (1, Vec3::new(9.0, 7.0, 5.0)),
            (2, Vec3::new(500.0, 300.0, 1e-3)),
            (3, Vec3::new(4.0, 4.0, 0.0)),
            (4, Vec3::new(40.0, 1e-2, 0.0)),
        ] {
            let truth = known(2.5);
            let source = cloud(50, seed, spread);
            let target: Vec<Vec3> = source.iter().map(|p| truth * *p).collect();
            let found = umeyama(&target, &source, true).unwrap();
            assert!((found.scale - 2.5).abs() < 1e-9, "{spread:?}: scale {}", found.scale);
            for (t, s) in target.iter().zip(&source) {
                assert!((found * *s - t).norm() < 1e-9, "{spread:?}: {}", (found * *s - t).norm());
            }
            let rigid = umeyama(&target, &source, false).unwrap();
            assert_eq!(rigid.scale, 1.0);
        }
    }

    #[test]
    fn mirrored_points_give_a_proper_rotation() {
        let source = cloud(30, 7, Vec3::new(3.0, 2.0, 1.0));
        let target: Vec<Vec3> = source.iter().map(|p| Vec3::new(p.x, p.y, -p.z)).collect();
        let found = umeyama(&target, &source, false).unwrap();
        assert!((found.rotation.matrix().determinant() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn noisy_fit_is_a_local_minimum() {
        let source = cloud(80, 11, Vec3::new(6.0, 5.0, 2.0));
        let noise = cloud(80, 12, Vec3::new(0.3, 0.3, 0.3));
        let target: Vec<Vec3> = source.iter().zip(&noise).map(|(p, n)| known(1.7) * *p + n).collect();
        let cost =
            |t: &Sim3| -> f64 { source.iter().zip(&target).map(|(s, p)| (*t * *s - p).norm_squared()).sum() };
        let found = umeyama(&target, &source, true).unwrap();
        let best = cost(&found);
        for axis in 0..7 {
            for step in [-1e-4, 1e-4] {
                let mut moved = found;
                match axis {
                    0..3 => moved.translation[axis] += step,
                    3..6 => {
                        let mut w = Vec3::zeros();
                        w[axis - 3] = step;
                        moved.rotation = moved.rotation * So3::exp(&w);
                    }
                    _ => moved.scale += step,
                }
                assert!(cost(&moved) > best, "axis {axis}, step {step}");
            }
        }
    }

    #[test]
    fn degenerate_input_is_rejected() {
        let line: Vec<Vec3> = (0..20).map(|i| Vec3::new(1.0, 2.0, -0.5) * f64::from(i)).collect();
        assert!(matches!(umeyama(&line, &line, true), Err(Degenerate::Collinear { .. })));
        let still = vec![Vec3::new(3.0, 1.0, 2.0); 10];
        assert!(matches!(umeyama(&still, &still, false), Err(Degenerate::Collinear { .. })));
        let good = cloud(10, 3, Vec3::new(1.0, 1.0, 1.0));
        assert!(matches!(umeyama(&good, &still, true), Err(Degenerate::Collinear { .. })));
        assert_eq!(umeyama(&good[..2], &good[..2], false), Err(Degenerate::TooFew { pairs: 2, need: 3 }));
        assert_eq!(umeyama(&good, &good[1..], false), Err(Degenerate::Unpaired { target: 10, source: 9 }));
        let mut broken = good.clone();
        broken[4].y = f64::NAN;
        assert_eq!(umeyama(&good, &broken, false), Err(Degenerate::NotFinite));
    }

    #[test]
    fn decomposition_reproduces_the_matrix() {
        for m in [
            Mat3::new(2.0, -1.0, 0.3, 0.4, 5.0, 1.0, -3.0, 0.2, 0.9),
            Mat3::from_diagonal(&Vec3::new(1e-9, 4.0, 1.0)),
            Mat3::identity(),
        ] {
            let (u, d, v) = singular_values(&m);
            assert!((u * Mat3::from_diagonal(&d) * v.transpose() - m).norm() < 1e-14 * m.norm().max(1.0));
            assert!((u.transpose() * u - Mat3::identity()).norm() < 1e-14);
            assert!((v.transpose() * v - Mat3::identity()).norm() < 1e-14);
            assert!(d.x >= d.y && d.y >= d.z);
        }
    }
}
