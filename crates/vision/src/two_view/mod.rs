//! Two-view initialisation of a single camera: the relative motion and the points visible in both views, up to scale.
//!
//! A homography (plane, or pure rotation) and an essential matrix (anything else) are estimated from the same seeded
//! RANSAC samples. The motions of both models are refined and compared on all matches; the winner must be unambiguous,
//! have its points in front of both cameras, and have parallax. After Mur-Artal et al. 2015 (ORB-SLAM), section IV,
//! with five-point essential matrices (the camera is calibrated) and a refinement over five unknowns.

mod five_point;
mod homography;
mod refine;
mod score;
mod verify;

pub use five_point::five_point;
pub use homography::{four_point, motions as homography_motions};
pub use verify::{Verified, verify_two_views};

use crate::RectifiedCamera;
use crate::triangulate::{correct, essential, midpoint};
use cairn_geometry::{Mat3, Se3, So3, Vec2, Vec3};
use cairn_random::Random;
use cairn_solve::ransac::iterations;
use score::{CHI2_1, CHI2_2, Match};
use std::fmt;

/// Configuration of the two-view initialisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoViewConfig {
    /// Maximum number of RANSAC samples.
    pub iterations: usize,
    /// Standard deviation of a keypoint in pixels.
    pub sigma_px: f64,
    /// Minimum number of triangulated points.
    pub min_points: usize,
    /// Of the matches on their epipolar lines, the fraction that must be in front of both cameras or too far away to
    /// decide.
    pub min_front_share: f64,
    /// Minimum parallax of the result in degrees: half of the points, or fifty, must have at least this.
    pub min_parallax_deg: f64,
    /// Minimum parallax of a single point in degrees.
    pub point_parallax_deg: f64,
    /// A different motion with more than this fraction of the winner's score makes the result ambiguous.
    pub ambiguity: f64,
    /// Ratio of scores, `S_H / (S_H + S_F)`, above which the scene is reported as planar (or without parallax).
    pub homography_ratio: f64,
}

impl Default for TwoViewConfig {
    fn default() -> Self {
        Self {
            iterations: 200,
            sigma_px: 1.0,
            min_points: 50,
            min_front_share: 0.9,
            min_parallax_deg: 1.0,
            point_parallax_deg: 0.4,
            ambiguity: 0.87,
            homography_ratio: 0.45,
        }
    }
}

/// Which model explains the matches better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwoViewModel {
    /// A planar scene, or low parallax.
    Homography,
    /// Points at many depths.
    Essential,
}

/// Result of a two-view initialisation.
#[derive(Clone, Debug)]
pub struct TwoView {
    /// The motion; its translation has length one.
    pub second_from_first: Se3,
    /// For each match its point in the first camera's frame, in units of the translation, if triangulated.
    pub points: Vec<Option<Vec3>>,
    /// Parallax in degrees that half of the points, or fifty, exceed.
    pub parallax_deg: f64,
    /// Which model explained the matches better.
    pub model: TwoViewModel,
    /// `S_H / (S_H + S_F)`.
    pub homography_ratio: f64,
}

impl TwoView {
    /// Number of triangulated matches.
    pub fn point_count(&self) -> usize {
        self.points.iter().flatten().count()
    }
}

/// Why two views were rejected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TwoViewReason {
    /// Fewer matches than the minimum number of points.
    TooFewMatches,
    /// No model explains enough matches.
    TooFewInliers,
    /// Too little parallax: pure rotation, no motion, or a distant scene.
    LowParallax,
    /// Two different motions explain the matches almost equally well.
    Ambiguous,
    /// Too few points are in front of both cameras.
    TooFewPoints,
}

/// A rejected pair of views, with the numbers that explain why; values of stages not reached are zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TwoViewRejected {
    /// The reason.
    pub reason: TwoViewReason,
    /// Matches given.
    pub matches: usize,
    /// Inliers of the best motion.
    pub inliers: usize,
    /// Triangulated points of the best motion.
    pub points: usize,
    /// Score of the best different motion relative to the best motion.
    pub other_share: f64,
    /// Parallax of the best motion in degrees.
    pub parallax_deg: f64,
    /// `S_H / (S_H + S_F)`.
    pub homography_ratio: f64,
}

impl fmt::Display for TwoViewRejected {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { matches, inliers, points, other_share, parallax_deg, .. } = self;
        match self.reason {
            TwoViewReason::TooFewMatches => write!(f, "too few matches: {matches}"),
            TwoViewReason::TooFewInliers => {
                write!(f, "only {inliers} of {matches} matches are consistent with one motion")
            }
            TwoViewReason::LowParallax => write!(f, "the parallax of {parallax_deg:.2} degrees is too low"),
            TwoViewReason::Ambiguous => {
                write!(f, "ambiguous: a second motion scores {:.0} % of the first", other_share * 100.0)
            }
            TwoViewReason::TooFewPoints => {
                write!(f, "only {points} points triangulated from {inliers} inliers")
            }
        }
    }
}

impl std::error::Error for TwoViewRejected {}

/// A motion and its support by the matches.
struct Candidate {
    motion: Se3,
    points: Vec<Option<Vec3>>,
    count: usize,
    /// Sum over its inliers (equation 2 of the paper): smaller errors count more.
    score: f64,
    inliers: usize,
    /// Matches on their epipolar lines, regardless of depth.
    on_lines: usize,
    parallax_deg: f64,
}

/// Estimates the motion between two views from matched rectified pixels (`first[i]` and `second[i]` are one point). The
/// same seed gives the same result.
///
/// # Errors
/// When the views do not determine a unique motion with enough points; [`TwoViewRejected`] holds the reason and
/// numbers.
pub fn two_view(
    camera: &RectifiedCamera,
    first: &[[f32; 2]],
    second: &[[f32; 2]],
    config: &TwoViewConfig,
    seed: u64,
) -> Result<TwoView, TwoViewRejected> {
    let n = first.len().min(second.len());
    let mut rejected = TwoViewRejected {
        reason: TwoViewReason::TooFewMatches,
        matches: n,
        inliers: 0,
        points: 0,
        other_share: 0.0,
        parallax_deg: 0.0,
        homography_ratio: 0.0,
    };
    if n < config.min_points.max(8) {
        return Err(rejected);
    }
    let focal = (camera.fx * camera.fy).sqrt();
    let sigma = config.sigma_px / focal;
    let matches = normalised_matches(camera, first, second);
    let best = search(&matches, sigma, config, seed);
    rejected.homography_ratio = best.ratio();
    rejected.reason = TwoViewReason::TooFewInliers;

    let mut candidates = best.candidates(&matches, sigma, config);
    let Some(winner) = take_best(&mut candidates) else { return Err(rejected) };
    let other =
        candidates.iter().filter(|c| differ(&c.motion, &winner.motion)).map(|c| c.score).fold(0.0, f64::max);
    rejected.inliers = winner.inliers;
    rejected.points = winner.count;
    rejected.other_share = other / winner.score.max(f64::MIN_POSITIVE);
    rejected.parallax_deg = winner.parallax_deg;
    // Parallax that noise alone can cause.
    let noise_deg = (3.0 * std::f64::consts::SQRT_2 * sigma).to_degrees();
    rejected.reason = if winner.inliers < config.min_points {
        TwoViewReason::TooFewInliers
    } else if winner.parallax_deg < config.min_parallax_deg.max(noise_deg) {
        TwoViewReason::LowParallax
    } else if winner.count < config.min_points
        || (winner.inliers as f64) < config.min_front_share * winner.on_lines as f64
    {
        TwoViewReason::TooFewPoints
    } else if rejected.other_share > config.ambiguity {
        TwoViewReason::Ambiguous
    } else {
        let ratio = best.ratio();
        let plane = ratio > config.homography_ratio;
        return Ok(TwoView {
            second_from_first: winner.motion,
            points: winner.points,
            parallax_deg: winner.parallax_deg,
            model: if plane { TwoViewModel::Homography } else { TwoViewModel::Essential },
            homography_ratio: ratio,
        });
    };
    Err(rejected)
}

/// Number of different essential matrices that are refined.
const KEPT_ESSENTIALS: usize = 4;
/// Essential matrices (of norm root two) closer than this are treated as the same.
const SAME_ESSENTIAL: f64 = 0.25;
/// Maximum number of matches in the first evaluation of a motion.
const FIRST_MATCHES: usize = 150;

/// The best models of both kinds.
struct Best {
    homography: Option<Mat3>,
    homography_score: f64,
    /// With their scores, best first.
    essentials: Vec<(f64, Mat3)>,
}

/// RANSAC over samples of five matches; the first four of each also give a homography.
fn search(matches: &[Match], sigma: f64, config: &TwoViewConfig, seed: u64) -> Best {
    // The scores expect coordinates with unit standard deviation.
    let scaled: Vec<Match> = matches.iter().map(|m| m.map(|c| c / sigma)).collect();
    let to_unit = Mat3::from_diagonal(&Vec3::new(sigma, sigma, 1.0));
    let from_unit = Mat3::from_diagonal(&Vec3::new(1.0 / sigma, 1.0 / sigma, 1.0));
    let mut best =
        Best { homography: None, homography_score: 0.0, essentials: Vec::with_capacity(KEPT_ESSENTIALS + 1) };
    let mut rng = Random::stream(seed, 2);
    let mut limit = config.iterations;
    let mut done = 0;
    while done < limit {
        done += 1;
        let Some(sample) = rng.sample::<5>(matches.len()) else { break };
        let four = |at: usize| -> [Vec2; 4] {
            std::array::from_fn(|k| Vec2::new(matches[sample[k]][at], matches[sample[k]][at + 1]))
        };
        if let Some(h) = four_point(&four(0), &four(2)) {
            let h_scaled = from_unit * h * to_unit;
            if let Some(inverse) = h_scaled.try_inverse() {
                let s = score::homography(&h_scaled, &inverse, &scaled);
                if s > best.homography_score {
                    (best.homography, best.homography_score) = (Some(h), s);
                }
            }
        }
        let rays = |at: usize| -> [Vec3; 5] {
            std::array::from_fn(|k| {
                Vec3::new(matches[sample[k]][at], matches[sample[k]][at + 1], 1.0).normalize()
            })
        };
        five_point(&rays(0), &rays(2), |e| {
            let f = to_unit * e * to_unit;
            let s = score::fundamental(&f, &scaled);
            if best.insert(s, e) {
                let share = score::fundamental_inliers(&f, &scaled) as f64 / scaled.len() as f64;
                limit = iterations(share, 5, 0.9999, config.iterations).max(config.iterations.min(30));
            }
        });
    }
    best
}

impl Best {
    fn ratio(&self) -> f64 {
        let essential = self.essentials.first().map_or(0.0, |e| e.0);
        self.homography_score / (self.homography_score + essential).max(f64::MIN_POSITIVE)
    }

    /// Keeps an essential matrix if it is among the best distinct ones; true when it is the best of all.
    fn insert(&mut self, score: f64, e: Mat3) -> bool {
        if self.essentials.len() == KEPT_ESSENTIALS && score <= self.essentials[KEPT_ESSENTIALS - 1].0 {
            return false;
        }
        let near = |o: &Mat3| (o - e).norm().min((o + e).norm()) < SAME_ESSENTIAL;
        if self.essentials.iter().any(|(s, o)| *s >= score && near(o)) {
            return false;
        }
        self.essentials.retain(|(_, o)| !near(o));
        let at = self.essentials.partition_point(|(s, _)| *s >= score);
        self.essentials.insert(at, (score, e));
        self.essentials.truncate(KEPT_ESSENTIALS);
        at == 0
    }

    /// The motions of all models, refined and evaluated; those with far fewer inliers than the best are dropped early.
    fn candidates(&self, matches: &[Match], sigma: f64, config: &TwoViewConfig) -> Vec<Candidate> {
        let stride = matches.len().div_ceil(FIRST_MATCHES);
        let subset: Vec<Match> = matches.iter().step_by(stride).copied().collect();
        let from_homography = self.homography.as_ref().and_then(homography_motions).into_iter().flatten();
        let from_essential = self.essentials.iter().filter_map(|e| essential_motions(&e.1)).flatten();
        // With a looser threshold at first: a model from five noisy points is not exact.
        let evaluated: Vec<Candidate> = from_homography
            .chain(from_essential)
            .map(|motion| evaluate(motion, &subset, 2.0 * sigma, config))
            .collect();
        let max_inliers = evaluated.iter().map(|c| c.inliers).max().unwrap_or(0);
        evaluated
            .into_iter()
            .filter(|c| c.inliers * 2 >= max_inliers)
            .map(|c| {
                let motion = refine::refine(&c.motion, matches, sigma);
                evaluate(motion, matches, sigma, config)
            })
            .collect()
    }
}

fn take_best(candidates: &mut Vec<Candidate>) -> Option<Candidate> {
    let mut best = 0;
    for (k, c) in candidates.iter().enumerate() {
        if c.score > candidates[best].score {
            best = k;
        }
    }
    (!candidates.is_empty()).then(|| candidates.swap_remove(best))
}

/// True when two motions differ by more than two degrees in rotation or ten degrees in direction of translation.
fn differ(a: &Se3, b: &Se3) -> bool {
    (a.rotation.inverse() * b.rotation).angle() > 2f64.to_radians()
        || a.translation.dot(&b.translation) < 10f64.to_radians().cos()
}

/// The four motions of an essential matrix (Hartley and Zisserman 2004, result 9.19), with unit translation.
pub fn essential_motions(e: &Mat3) -> Option<[Se3; 4]> {
    let svd = e.svd(true, true);
    let (mut u, mut vt) = (svd.u?, svd.v_t?);
    // The sign of the columns of the zero singular value is free: chosen so that both matrices are rotations.
    let (sign_u, sign_v) = (u.determinant().signum(), vt.determinant().signum());
    u.column_mut(2).scale_mut(sign_u);
    vt.row_mut(2).scale_mut(sign_v);
    let w = Mat3::new(0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0);
    let (r1, r2) = (So3::from_matrix(&(u * w * vt)), So3::from_matrix(&(u * w.transpose() * vt)));
    let t: Vec3 = u.column(2).into();
    let all = [Se3::new(r1, t), Se3::new(r1, -t), Se3::new(r2, t), Se3::new(r2, -t)];
    all.iter().all(Se3::is_finite).then_some(all)
}

/// Triangulates all matches under a motion. Inliers are close to both epipolar lines and either in front of both
/// cameras or too far away to decide; matches with parallax also get a point.
fn evaluate(motion: Se3, matches: &[Match], sigma: f64, config: &TwoViewConfig) -> Candidate {
    let e = essential(&motion);
    let inverse = motion.rotation.inverse();
    let (line, pixel) = (CHI2_1 * sigma * sigma, CHI2_2 * sigma * sigma);
    let mut points = vec![None; matches.len()];
    let mut parallaxes = Vec::with_capacity(matches.len());
    let (mut inliers, mut on_lines, mut total) = (0, 0, 0.0);
    for (point, m) in points.iter_mut().zip(matches) {
        let distances = score::line_distances(&e, m);
        if !distances.iter().all(|&d| d < line) {
            continue;
        }
        on_lines += 1;
        let (a, b) = (Vec2::new(m[0], m[1]), Vec2::new(m[2], m[3]));
        let in_first = inverse * b.push(1.0);
        let parallax = a.push(1.0).cross(&in_first).norm().atan2(a.push(1.0).dot(&in_first)).to_degrees();
        let [ca, cb] = correct(&e, &a, &b);
        let correction = (ca - a).norm_squared().max((cb - b).norm_squared());
        let intersection = midpoint(&motion, &ca.push(1.0), &cb.push(1.0));
        let in_front = intersection.is_some_and(|p| p.z > 0.0 && (motion * p).z > 0.0);
        if correction > pixel || !in_front && parallax > config.point_parallax_deg {
            continue;
        }
        inliers += 1;
        total += distances.iter().map(|d| CHI2_2 - d / (sigma * sigma)).sum::<f64>();
        if in_front {
            parallaxes.push(parallax);
            if parallax > config.point_parallax_deg {
                *point = intersection;
            }
        }
    }
    parallaxes.sort_by(|a, b| b.total_cmp(a));
    let parallax_deg = match parallaxes.len() {
        0 => 0.0,
        n => parallaxes[(n / 2).min(50)],
    };
    let count = points.iter().flatten().count();
    Candidate { motion, points, count, score: total, inliers, on_lines, parallax_deg }
}

/// Converts matches of pixels to normalised image coordinates (z = 1).
fn normalised_matches(camera: &RectifiedCamera, first: &[[f32; 2]], second: &[[f32; 2]]) -> Vec<Match> {
    let unit = |p: [f32; 2]| camera.unproject(p, 1.0).xy();
    let pair = |(&a, &b)| {
        let (a, b) = (unit(a), unit(b));
        [a.x, a.y, b.x, b.y]
    };
    first.iter().zip(second).map(pair).collect()
}
