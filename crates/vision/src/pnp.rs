//! PnP with RANSAC: the camera pose from known points and their bearings, robust to wrong matches. Minimal samples of
//! three (see [`p3p`](crate::p3p)); the best pose is refined on its inliers until they no longer change.

use crate::p3p::p3p;
use cairn_geometry::{Se3, Vec3, hat};
use cairn_random::Random;
use cairn_solve::ransac::iterations;
use nalgebra::{SMatrix, SVector};
use std::fmt;

/// Configuration of [`pnp_ransac`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PnpConfig {
    /// Maximum number of RANSAC samples.
    pub iterations: usize,
    /// Required probability that at least one sample without outliers is drawn.
    pub confidence: f64,
    /// Inlier threshold in radians on the angle between a point's direction and its bearing: 2.45 standard deviations
    /// cover 95 % of two-dimensional noise, so `2.45 * sigma_px / fx`.
    pub threshold_rad: f64,
    /// Minimum number of inliers.
    pub min_inliers: usize,
}

impl Default for PnpConfig {
    /// For a keypoint noise of 1.5 px at a focal length of 460 px.
    fn default() -> Self {
        Self { iterations: 300, confidence: 0.999, threshold_rad: 0.008, min_inliers: 12 }
    }
}

/// A pose and its inliers.
#[derive(Clone, Debug, PartialEq)]
pub struct PnpResult {
    /// Maps world points into the camera frame.
    pub camera_from_world: Se3,
    /// Indices of the inlier matches, in rising order.
    pub inliers: Vec<usize>,
    /// Samples drawn.
    pub iterations: usize,
}

/// No pose was found, with the numbers that explain why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PnpRejected {
    /// Matches given.
    pub matches: usize,
    /// Inliers of the best pose found.
    pub inliers: usize,
    /// Minimum number of inliers.
    pub need: usize,
}

impl fmt::Display for PnpRejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no pose: {} of {} matches are inliers, {} needed", self.inliers, self.matches, self.need)
    }
}

impl std::error::Error for PnpRejected {}

/// Finds the pose with the best consensus: `points[i]` (world frame) is observed at the unit bearing `bearings[i]`
/// (camera frame). The same seed gives the same result.
///
/// # Errors
/// When there are too few matches or inliers; [`PnpRejected`] holds the counts.
pub fn pnp_ransac(
    points: &[Vec3],
    bearings: &[Vec3],
    config: &PnpConfig,
    seed: u64,
) -> Result<PnpResult, PnpRejected> {
    let n = points.len().min(bearings.len());
    let (points, bearings) = (&points[..n], &bearings[..n]);
    let need = config.min_inliers.max(4);
    let mut rejected = PnpRejected { matches: n, inliers: 0, need };
    if n < need {
        return Err(rejected);
    }
    let bound = (2.0 * (0.5 * config.threshold_rad).sin()).powi(2);
    let mut rng = Random::stream(seed, 3);
    let mut best: Option<(f64, Se3)> = None;
    let (mut done, mut limit) = (0, config.iterations.max(1));
    while done < limit {
        done += 1;
        let Some(sample) = rng.sample::<3>(n) else { break };
        let mut better = None;
        p3p(&sample.map(|i| points[i]), &sample.map(|i| bearings[i]), |pose| {
            let cost = cost(&pose, points, bearings, bound);
            if best.as_ref().is_none_or(|b| cost < b.0) && better.is_none_or(|(c, _)| cost < c) {
                better = Some((cost, pose));
            }
        });
        let Some((mut cost_here, mut pose)) = better else { continue };
        // Local optimisation (Chum, Matas, Kittler 2003): a pose from three noisy points is refined on all its inliers.
        let refined = refine(&pose, points, bearings, &inliers(&pose, points, bearings, bound), 3);
        let refined_cost = cost(&refined, points, bearings, bound);
        if refined_cost < cost_here {
            (cost_here, pose) = (refined_cost, refined);
        }
        best = Some((cost_here, pose));
        let share = inliers(&pose, points, bearings, bound).len() as f64 / n as f64;
        limit = iterations(share, 3, config.confidence, config.iterations);
    }
    let Some((_, mut pose)) = best else { return Err(rejected) };
    let mut consensus = inliers(&pose, points, bearings, bound);
    for _ in 0..5 {
        let refined = refine(&pose, points, bearings, &consensus, 5);
        let now = inliers(&refined, points, bearings, bound);
        if now.len() < consensus.len() {
            break;
        }
        let unchanged = now == consensus;
        (pose, consensus) = (refined, now);
        if unchanged {
            break;
        }
    }
    rejected.inliers = consensus.len();
    if consensus.len() < need {
        return Err(rejected);
    }
    Ok(PnpResult { camera_from_world: pose, inliers: consensus, iterations: done })
}

/// Truncated sum of squared chord lengths between directions and bearings (MSAC, Torr and Zisserman 2000).
fn cost(pose: &Se3, points: &[Vec3], bearings: &[Vec3], bound: f64) -> f64 {
    let r = pose.rotation.matrix();
    points
        .iter()
        .zip(bearings)
        .map(|(p, b)| ((r * p + pose.translation).normalize() - b).norm_squared().min(bound))
        // NaN counts as an outlier.
        .map(|c| if c.is_nan() { bound } else { c })
        .sum()
}

fn inliers(pose: &Se3, points: &[Vec3], bearings: &[Vec3], bound: f64) -> Vec<usize> {
    let r = pose.rotation.matrix();
    let is_inlier =
        |i: &usize| ((r * points[*i] + pose.translation).normalize() - bearings[*i]).norm_squared() < bound;
    (0..points.len()).filter(is_inlier).collect()
}

/// Gauss-Newton on the directions of some points: residual `q / |q| - bearing`, with `q` the point in the camera frame.
pub(crate) fn refine(start: &Se3, points: &[Vec3], bearings: &[Vec3], which: &[usize], steps: usize) -> Se3 {
    let mut pose = *start;
    if which.len() < 4 {
        return pose;
    }
    for _ in 0..steps {
        let r = pose.rotation.matrix();
        let mut h = SMatrix::<f64, 6, 6>::zeros();
        let mut g = SVector::<f64, 6>::zeros();
        for &i in which {
            let q = r * points[i] + pose.translation;
            let norm = q.norm();
            let direction = q / norm;
            // The derivative of a direction is perpendicular to it: d(q/|q|) = (I - d d') / |q| dq.
            let across = (nalgebra::Matrix3::identity() - direction * direction.transpose()) / norm;
            let residual = direction - bearings[i];
            // Perturbed on the right: q moves by R t - R [p]x w.
            let mut j = SMatrix::<f64, 3, 6>::zeros();
            j.fixed_view_mut::<3, 3>(0, 0).copy_from(&(across * r));
            j.fixed_view_mut::<3, 3>(0, 3).copy_from(&(-across * r * hat(&points[i])));
            h += j.tr_mul(&j);
            g += j.tr_mul(&residual);
        }
        let Some(step) = h.cholesky().map(|c| -c.solve(&g)) else { return pose };
        let next = pose * Se3::exp(&step);
        if !next.is_finite() {
            return pose;
        }
        pose = next;
        if step.norm() < 1e-10 {
            break;
        }
    }
    pose
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    /// `n` points 2 to 9 m away and their bearings with one pixel of noise at f = 460; a fraction `outliers` of the
    /// bearings is random.
    fn simulated_matches(
        rng: &mut Random,
        n: usize,
        outliers: f64,
        flat: bool,
    ) -> (Se3, Vec<Vec3>, Vec<Vec3>, Vec<bool>) {
        let v = |rng: &mut Random, s: f64| {
            Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal()) * s
        };
        let turn = v(rng, 0.8);
        let truth = Se3::new(So3::exp(&turn), v(rng, 4.0));
        let (mut points, mut bearings, mut good) = (vec![], vec![], vec![]);
        for _ in 0..n {
            let mut ray = || Vec3::new(rng.uniform(-0.8, 0.8), rng.uniform(-0.5, 0.5), 1.0);
            let (at, random_ray) = (ray(), ray());
            let z = if flat { 5.0 + at.x } else { rng.uniform(2.0, 9.0) };
            points.push(truth.inverse() * (at * z));
            let outlier = rng.unit() < outliers;
            let noise = v(rng, 1.0 / 460.0);
            bearings.push((if outlier { random_ray } else { at + noise }).normalize());
            good.push(!outlier);
        }
        (truth, points, bearings, good)
    }

    #[test]
    fn finds_the_pose_despite_outliers() {
        for (outliers, n) in [(0.0, 40), (0.3, 60), (0.5, 80), (0.7, 120)] {
            for flat in [false, true] {
                let (mut found, mut angles, mut shifts, mut drawn) = (0, vec![], vec![], 0);
                let mut ms = f64::INFINITY;
                for seed in 0..100 {
                    let mut rng = Random::stream(seed, 9);
                    let (truth, points, bearings, good) = simulated_matches(&mut rng, n, outliers, flat);
                    let start = std::time::Instant::now();
                    let result = pnp_ransac(&points, &bearings, &PnpConfig::default(), seed);
                    ms = ms.min(start.elapsed().as_secs_f64() * 1e3);
                    let Ok(result) = result else { continue };
                    let error = result.camera_from_world.inverse() * truth;
                    let wrong = result.inliers.iter().filter(|&&i| !good[i]).count();
                    if error.rotation.angle() < 0.02 && error.translation.norm() < 0.15 && wrong <= 3 {
                        found += 1;
                    }
                    angles.push(error.rotation.angle().to_degrees());
                    shifts.push(error.translation.norm());
                    drawn += result.iterations;
                }
                let median = |v: &mut Vec<f64>| {
                    v.sort_by(f64::total_cmp);
                    v[v.len() / 2]
                };
                println!(
                    "{n} points, outliers {outliers}, flat {flat}: {found} of 100 found, median error {:.3} deg \
                     {:.4} m, {} samples, fastest {ms:.3} ms",
                    median(&mut angles),
                    median(&mut shifts),
                    drawn / 100
                );
                assert!(found >= 97, "{found}");
            }
        }
    }

    #[test]
    fn random_matches_are_rejected_with_counts() {
        let config = PnpConfig::default();
        let mut rng = Random::new(10);
        let mut v = || Vec3::new(rng.standard_normal(), rng.standard_normal(), rng.standard_normal());
        let points: Vec<Vec3> = (0..60).map(|_| v()).collect();
        let bearings: Vec<Vec3> = (0..60).map(|_| v().normalize()).collect();
        let e = pnp_ransac(&points, &bearings, &config, 1).unwrap_err();
        assert!(e.inliers < e.need && e.matches == 60, "{e}");
        assert_eq!(pnp_ransac(&points[..5], &bearings, &config, 1).unwrap_err().matches, 5);
        assert!(pnp_ransac(&[Vec3::repeat(f64::NAN); 20], &bearings[..20], &config, 1).is_err());
        assert!(pnp_ransac(&[Vec3::x(); 20], &[Vec3::x(); 20], &config, 1).is_err());
    }

    #[test]
    fn same_seed_gives_the_same_pose() {
        let (_, points, bearings, _) = simulated_matches(&mut Random::new(12), 60, 0.4, false);
        let run = || pnp_ransac(&points, &bearings, &PnpConfig::default(), 5).unwrap();
        assert_eq!(run(), run());
    }
}
