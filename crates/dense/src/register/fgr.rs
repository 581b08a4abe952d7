//! The pose that most matches agree on.
//!
//! Zhou, Park and Koltun, "Fast global registration" (ECCV 2016): the line process of equations 3 and 6 with graduated
//! non-convexity. For fixed weights the pose is found in closed form (Kabsch 1976; with gravity one angle), where the
//! paper takes a step of Gauss-Newton: each round is then the exact minimum of equation 3 over the pose.

use super::matches::Match;
use cairn_geometry::{Mat3, Se3, So3, Vec3};

/// The scale is divided by this in each round.
const DIVISOR: f64 = 2.0;

/// `target_from_source` of matches, with how many lie within `tolerance_m` at the end. With `ups` (unit, of target and
/// source) only yaw and translation are free. `None` when fewer than three agree.
pub(super) fn align(matches: &[Match], ups: Option<[Vec3; 2]>, tolerance_m: f64) -> Option<(Se3, usize)> {
    let mut pose = weighted(matches, |_| 1.0, ups)?;
    let farthest = matches.iter().map(|m| (m.target - pose * m.source).norm_squared()).fold(0.0, f64::max);
    let last = tolerance_m * tolerance_m;
    let mut mu = farthest.max(last);
    loop {
        // Two rounds at each scale.
        for _ in 0..2 {
            let at = pose;
            pose = weighted(matches, |m| line_process(m, &at, mu), ups)?;
        }
        if mu <= last {
            break;
        }
        mu = (mu / DIVISOR).max(last);
    }
    let agree = matches.iter().filter(|m| (m.target - pose * m.source).norm_squared() <= last).count();
    (agree >= 3 && pose.is_finite()).then_some((pose, agree))
}

/// Equation 6.
fn line_process(m: &Match, pose: &Se3, mu: f64) -> f64 {
    let square = (m.target - *pose * m.source).norm_squared();
    (mu / (mu + square)).powi(2)
}

/// The pose with the least weighted sum of squares.
fn weighted(matches: &[Match], weight: impl Fn(&Match) -> f64, ups: Option<[Vec3; 2]>) -> Option<Se3> {
    let weights: Vec<f64> = matches.iter().map(weight).collect();
    let sum: f64 = weights.iter().sum();
    if !(sum > 1e-9 && matches.len() >= 3) {
        return None;
    }
    let mean =
        |f: &dyn Fn(&Match) -> Vec3| matches.iter().zip(&weights).map(|(m, w)| f(m) * *w).sum::<Vec3>() / sum;
    let (p, q) = (mean(&|m| m.target), mean(&|m| m.source));
    let mut cross = Mat3::zeros();
    for (m, w) in matches.iter().zip(&weights) {
        cross += (m.target - p) * (m.source - q).transpose() * *w;
    }
    let rotation = match ups {
        Some([up, other]) => about(&cross, &up, &other)?,
        None => kabsch(&cross)?,
    };
    Some(Se3::new(rotation, p - rotation * q))
}

/// The rotation that maximises the trace of its transpose times `cross`.
fn kabsch(cross: &Mat3) -> Option<So3> {
    let svd = cross.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    let flip = Mat3::from_diagonal(&Vec3::new(1.0, 1.0, sign));
    // The smallest singular value is the last: nalgebra sorts them.
    Some(So3::from_matrix(&(u * flip * v_t)))
}

/// The same among the rotations that keep gravity: upright, then by one angle about `up`.
fn about(cross: &Mat3, up: &Vec3, other: &Vec3) -> Option<So3> {
    let upright = upright(up, other);
    let turned = cross * upright.matrix().transpose();
    let (x, y) = plane(up);
    let part = |a: &Vec3, b: &Vec3| a.dot(&(turned * b));
    let (cos, sin) = (part(&x, &x) + part(&y, &y), part(&y, &x) - part(&x, &y));
    let angle = sin.atan2(cos);
    angle.is_finite().then(|| So3::exp(&(up * angle)) * upright)
}

/// A rotation that takes `other` to `up`.
pub(super) fn upright(up: &Vec3, other: &Vec3) -> So3 {
    let axis = other.cross(up);
    let (sin, cos) = (axis.norm(), other.dot(up));
    if sin > 1e-12 {
        return So3::exp(&(axis / sin * sin.atan2(cos)));
    }
    if cos > 0.0 { So3::identity() } else { So3::exp(&(plane(up).0 * std::f64::consts::PI)) }
}

/// Two directions that with `up` make a right-handed frame.
fn plane(up: &Vec3) -> (Vec3, Vec3) {
    let least = up.iamin();
    let x = up.cross(&Vec3::from_fn(|i, _| f64::from(u8::from(i == least)))).normalize();
    (x, up.cross(&x))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(pose: &Se3, wrong: usize) -> Vec<Match> {
        let at = |i: usize| {
            let t = i as f64;
            Vec3::new((t * 1.3).sin() * 2.0, (t * 0.7).cos() * 1.5, (t * 2.1).sin())
        };
        let normals = [Vec3::z(), Vec3::z()];
        let of = |i: usize| {
            let away =
                if i < wrong { Vec3::new(0.7 + at(i + 5).x, at(i + 3).y, -0.9) } else { Vec3::zeros() };
            Match { target: *pose * at(i) + away, source: at(i), normals }
        };
        (0..40).map(of).collect()
    }

    #[test]
    fn a_third_of_wrong_matches_does_not_move_the_pose() {
        let pose = Se3::new(So3::exp(&Vec3::new(0.3, -1.9, 0.8)), Vec3::new(1.0, -2.0, 0.5));
        let (found, agree) = align(&cloud(&pose, 13), None, 0.02).expect("enough");
        assert_eq!(agree, 27);
        assert!((found.inverse() * pose).log().norm() < 1e-3, "{found:?}");
    }

    #[test]
    fn gravity_is_kept() {
        let (up, other) = (Vec3::new(0.1, -0.9, 0.2).normalize(), Vec3::new(0.3, 0.2, -0.8).normalize());
        let pose = Se3::new(So3::exp(&(up * 2.4)) * upright(&up, &other), Vec3::new(0.2, 3.0, 0.1));
        let (found, _) = align(&cloud(&pose, 10), Some([up, other]), 0.02).expect("enough");
        assert!((found.rotation * other - up).norm() < 1e-9);
        assert!((found.inverse() * pose).log().norm() < 1e-3, "{found:?}");
        // Also upside down.
        let (found, _) = align(&cloud(&Se3::identity(), 0), Some([up, -up]), 10.0).expect("enough");
        assert!((found.rotation * -up - up).norm() < 1e-9);
    }
}
