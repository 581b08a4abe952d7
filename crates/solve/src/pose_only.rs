//! The camera pose of one frame from matched points that stay fixed (motion-only bundle adjustment):
//! Levenberg-Marquardt with Huber's loss, in rounds; between rounds each match is classified again by its chi-square.
//! Everything but the matches and their classification lives in stack memory.
//!
//! Source: motion-only bundle adjustment, Mur-Artal & Tardós, "ORB-SLAM2" (2017), eq. 2.

use crate::levenberg_marquardt::{Convergence, Damping, LevenbergMarquardt};
use crate::matched_points::MatchedPoints;
use crate::reprojection::View;
use crate::{DenseNormal, Pinhole, PointMatch, Report, Stop, minimise_dense};
use cairn_geometry::{Manifold, Se3};
use nalgebra::SMatrix;

/// A prior on the pose, from what is known without the matches.
#[derive(Clone, Copy, Debug)]
pub struct PosePrior {
    /// The pose.
    pub world_from_camera: Se3,
    /// Information over (translation, rotation) of the camera.
    pub information: SMatrix<f64, 6, 6>,
}

/// Settings of [`PoseOnly::solve`].
#[derive(Clone, Copy, Debug)]
pub struct PoseOnlyConfig {
    /// Rounds of solving and classifying inliers; the loss is robust in all but the last two.
    pub rounds: usize,
    /// Maximum number of steps in a round.
    pub iterations: usize,
}

impl PoseOnlyConfig {
    fn solver(&self) -> LevenbergMarquardt {
        LevenbergMarquardt {
            iterations: self.iterations,
            damping: Damping::Factors {
                first: 1e-6,
                least: 1e-9,
                most: 1e3,
                shrink: 0.1,
                grow: 100.0,
                restart: 1e-4,
            },
            convergence: Convergence::Actual { relative: 1e-4 },
        }
    }
}

impl Default for PoseOnlyConfig {
    fn default() -> Self {
        Self { rounds: 4, iterations: 6 }
    }
}

/// The result of pose-only adjustment.
#[derive(Clone, Debug)]
pub struct PoseOnly {
    /// Pose of the camera.
    pub world_from_camera: Se3,
    /// For each match, whether its residual lies within the bound.
    pub inlier: Vec<bool>,
    /// Information matrix at the solution over (translation, rotation) of the camera, the prior included.
    pub information: SMatrix<f64, 6, 6>,
    /// How the solve went.
    pub report: Report,
}

/// Added to every diagonal entry of the normal equations, so that directions nothing constrains stay put.
const FLOOR: f64 = 1e-9;

impl PoseOnly {
    /// Solves from a first guess, with an optional prior on the pose.
    pub fn solve(
        camera: &Pinhole,
        guess: &Se3,
        matches: &[PointMatch],
        prior: Option<&PosePrior>,
        config: &PoseOnlyConfig,
    ) -> Self {
        let mut pose = *guess;
        let mut inlier = vec![true; matches.len()];
        let mut points = MatchedPoints::new(matches);
        let mut information = SMatrix::zeros();
        let mut report =
            Report { iterations: 0, cost_before: 0.0, cost_after: 0.0, inliers: 0, stop: Stop::Empty };
        for round in 0..config.rounds {
            let robust = round + 2 < config.rounds;
            let linearise = |pose: &Se3| {
                let normal = points.normal_equations(camera, pose, robust);
                prior.map_or(normal, |prior| with_prior(normal, prior, pose))
            };
            let solver = config.solver();
            let (found, normal, outcome) =
                minimise_dense(&solver, &pose, FLOOR, linearise, |pose, step| pose.retract(step));
            if round == 0 {
                report.cost_before = outcome.cost_before;
            }
            pose = found;
            information = normal.hessian;
            report.iterations += outcome.iterations;
            report.stop = outcome.stop;
            report.cost_after = normal.cost;
            report.inliers = Self::judge(camera, &pose, matches, &mut inlier);
            if report.inliers < 4 && prior.is_none() {
                break;
            }
            points.count_only(matches, &inlier);
        }
        Self { world_from_camera: pose, inlier, information, report }
    }

    /// Decides for each match whether its residual lies within the bound at a pose; returns how many do.
    pub fn judge(camera: &Pinhole, pose: &Se3, matches: &[PointMatch], inlier: &mut [bool]) -> usize {
        let view = View::new(pose);
        let mut count = 0;
        for (m, ok) in matches.iter().zip(inlier) {
            *ok = camera
                .residual(&view.to_camera(&m.point), &m.pixel)
                .is_some_and(|r| chi2(&r, m.weight) <= m.bound());
            count += *ok as usize;
        }
        count
    }
}

fn chi2(r: &[f64; 3], weight: f64) -> f64 {
    (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * weight
}

/// Adds a prior to normal equations; its Jacobian is taken as the identity, which is close enough near the prior.
fn with_prior(mut normal: DenseNormal<6>, prior: &PosePrior, pose: &Se3) -> DenseNormal<6> {
    let error = prior.world_from_camera.local(pose);
    let pull = prior.information * error;
    normal.hessian += prior.information;
    normal.gradient += pull;
    normal.cost += 0.5 * error.dot(&pull);
    normal
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{So3, Vec3};

    /// Points in a box, seen with a known pose; a fifth of the matches are wrong.
    #[test]
    fn finds_pose_and_outliers() {
        let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };
        let truth = Se3::new(So3::exp(&Vec3::new(0.1, 0.4, -0.2)), Vec3::new(0.5, -0.3, 0.2));
        let mut matches = Vec::new();
        for i in 0..200 {
            let a = i as f64;
            let q = Vec3::new((a * 0.7).sin() * 2.0, (a * 1.3).cos() * 1.5, 4.0 + (a * 0.37).sin() * 2.0);
            let u = camera.fx * q.x / q.z + camera.cx;
            let mut pixel = [u, camera.fy * q.y / q.z + camera.cy, u - camera.baseline_fx / q.z];
            if i % 3 == 0 {
                pixel[2] = f64::NAN;
            }
            if i % 5 == 0 {
                pixel[0] += 30.0 + a;
            }
            matches.push(PointMatch { point: truth * q, pixel, weight: 1.0 });
        }
        let guess = truth * Se3::new(So3::exp(&Vec3::new(0.03, -0.02, 0.04)), Vec3::new(0.1, 0.05, -0.1));
        let found = PoseOnly::solve(&camera, &guess, &matches, None, &PoseOnlyConfig::default());
        assert!(truth.local(&found.world_from_camera).norm() < 1e-6, "{:?}", found.report);
        for (i, ok) in found.inlier.iter().enumerate() {
            assert_eq!(*ok, i % 5 != 0, "match {i}");
        }
    }

    #[test]
    fn empty_input_gives_zero_inliers() {
        let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 0.0 };
        let found = PoseOnly::solve(&camera, &Se3::identity(), &[], None, &PoseOnlyConfig::default());
        assert_eq!(found.report.inliers, 0);
        assert!(found.world_from_camera.is_finite());
    }

    /// Two points leave most of the pose undetermined, so the prior fills it in; with many matches it hardly matters.
    #[test]
    fn prior_constrains_undetermined_directions() {
        let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 0.0 };
        let truth = Se3::new(So3::exp(&Vec3::new(0.1, 0.4, -0.2)), Vec3::new(0.5, -0.3, 0.2));
        let matches: Vec<PointMatch> = (0..120)
            .map(|i| {
                let a = i as f64;
                let q = Vec3::new((a * 0.7).sin() * 2.0, (a * 1.3).cos() * 1.5, 4.0 + (a * 0.37).sin());
                let pixel = [500.0 * q.x / q.z + 320.0, 500.0 * q.y / q.z + 240.0, f64::NAN];
                PointMatch { point: truth * q, pixel, weight: 1.0 }
            })
            .collect();
        let prior_pose = truth * Se3::new(So3::exp(&Vec3::new(0.01, 0.0, 0.0)), Vec3::new(0.0, 0.02, 0.0));
        let prior = PosePrior { world_from_camera: prior_pose, information: SMatrix::identity() * 1e3 };
        let solve = |matches: &[PointMatch]| {
            let found =
                PoseOnly::solve(&camera, &prior_pose, matches, Some(&prior), &PoseOnlyConfig::default());
            (truth.local(&found.world_from_camera).norm(), found.report.inliers)
        };
        let (few, many) = (solve(&matches[..2]), solve(&matches));
        assert!(few.0 < 0.025 && few.1 == 2, "{few:?}");
        assert!(many.0 < 1e-3 && many.1 == 120, "{many:?}");
    }
}
