//! Geometric verification: whether two images can show the same rigid scene, by how many matches are consistent with
//! one motion and how unlikely that is by chance.
//!
//! The criterion is the expected number of motions that as many random matches would be consistent with (a contrario),
//! after Moisan and Stival, "A probabilistic criterion to detect rigid point matches between two images and estimate
//! the fundamental matrix" (2004), equation 12, for one fixed threshold instead of the best of all.

use super::refine::refine;
use super::score::{self, CHI2_1};
use super::{TwoViewConfig, essential_motions, normalised_matches, search};
use crate::RectifiedCamera;
use crate::triangulate::essential;
use cairn_geometry::{Mat3, Vec3};

/// Result of the geometric verification of two images.
#[derive(Clone, Debug)]
pub struct Verified {
    /// For each match, whether it is an inlier of the best motion.
    pub inliers: Vec<bool>,
    /// log10 of the number of false alarms: the expected number of motions with as many inliers if all matches were
    /// random. Below 0 a chance agreement is unlikely, below -10 practically impossible.
    pub log10_false_alarms: f64,
}

impl Verified {
    /// Number of inliers.
    pub fn count(&self) -> usize {
        self.inliers.iter().filter(|i| **i).count()
    }
}

/// Matches in a minimal sample for an essential matrix.
const SAMPLE: usize = 5;
/// Maximum number of essential matrices per sample.
const MODELS: f64 = 10.0;

/// Finds the motion with the most inliers (`first[i]` and `second[i]` are one point, in rectified pixels). Unlike
/// [`super::two_view`] it needs no parallax: pure rotation or an unchanged pose also passes. `None` for fewer than
/// eight matches. The same seed gives the same result.
pub fn verify_two_views(
    camera: &RectifiedCamera,
    first: &[[f32; 2]],
    second: &[[f32; 2]],
    config: &TwoViewConfig,
    seed: u64,
) -> Option<Verified> {
    let n = first.len().min(second.len());
    if n < 8 {
        return None;
    }
    let sigma = config.sigma_px / (camera.fx * camera.fy).sqrt();
    let matches = normalised_matches(camera, first, second);
    let best = search(&matches, sigma, config, seed);
    let inliers_of = |e: &Mat3| -> Vec<bool> {
        let bound = CHI2_1 * sigma * sigma;
        matches.iter().map(|m| score::line_distances(e, m).iter().all(|&d| d < bound)).collect()
    };
    let count = |i: &Vec<bool>| i.iter().filter(|i| **i).count();
    let refined = best.essentials.iter().filter_map(|(_, e)| essential_motions(e)).map(|motions| {
        // The four motions of one essential matrix have the same epipolar lines.
        essential(&refine(&motions[0], &matches, sigma))
    });
    let all = best.essentials.iter().map(|(_, e)| *e).chain(refined);
    let mut inliers = vec![false; n];
    for found in all.map(|e| inliers_of(&e)) {
        if count(&found) > count(&inliers) {
            inliers = found;
        }
    }
    let [x0, y0, x1, y1] = camera.bounds;
    let (width, height) = (x1 - x0, y1 - y0);
    // A random point is close to a line with at most the probability of the strip along the image diagonal.
    let strip_area = 2.0 * CHI2_1.sqrt() * config.sigma_px * Vec3::new(width, height, 0.0).norm();
    let probability = (strip_area / (width * height)).clamp(1e-9, 1.0);
    Some(Verified { log10_false_alarms: log10_false_alarms(n, count(&inliers), probability), inliers })
}

/// `models (n - 5) C(n, k) C(k, 5) probability^(k - 5)`, as a logarithm.
fn log10_false_alarms(n: usize, k: usize, probability: f64) -> f64 {
    if k <= SAMPLE {
        return (MODELS * n as f64).log10();
    }
    let choose = |n: usize, k: usize| -> f64 {
        (0..k).map(|i| ((n - i) as f64).log10() - ((i + 1) as f64).log10()).sum()
    };
    MODELS.log10()
        + ((n - SAMPLE) as f64).log10()
        + choose(n, k)
        + choose(k, SAMPLE)
        + (k - SAMPLE) as f64 * probability.log10()
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::{Se3, So3};
    use cairn_random::Random;

    fn camera() -> RectifiedCamera {
        RectifiedCamera {
            fx: 400.0,
            fy: 400.0,
            cx: 320.0,
            cy: 240.0,
            baseline_fx: 0.0,
            bounds: [0.0, 0.0, 640.0, 480.0],
            close_depth: 0.0,
            body_from_camera: Se3::identity(),
        }
    }

    /// Matches of a scene in two views: `right` correct ones followed by `wrong` random ones.
    fn matches(motion: &Se3, right: usize, wrong: usize, seed: u64) -> [Vec<[f32; 2]>; 2] {
        let (camera, mut rng) = (camera(), Random::new(seed));
        let (mut a, mut b) = (Vec::new(), Vec::new());
        while a.len() < right {
            let p = [rng.uniform(0.0, 640.0) as f32, rng.uniform(0.0, 480.0) as f32];
            let q = *motion * camera.unproject(p, rng.uniform(2.0, 12.0));
            let Some([u, v, _]) = camera.project(&q).filter(|q| camera.contains(q[0], q[1])) else {
                continue;
            };
            a.push(p);
            b.push([(u + 0.5 * rng.standard_normal()) as f32, (v + 0.5 * rng.standard_normal()) as f32]);
        }
        for _ in 0..wrong {
            for side in [&mut a, &mut b] {
                side.push([rng.uniform(0.0, 640.0) as f32, rng.uniform(0.0, 480.0) as f32]);
            }
        }
        [a, b]
    }

    #[test]
    fn rigid_scenes_pass_and_random_matches_fail() {
        let config = TwoViewConfig::default();
        let motions = [
            Se3::new(So3::exp(&Vec3::new(0.02, 0.1, -0.03)), Vec3::new(0.5, 0.1, 0.3)),
            Se3::new(So3::exp(&Vec3::new(0.0, 0.15, 0.05)), Vec3::zeros()),
            Se3::identity(),
        ];
        for seed in 0..8 {
            for motion in &motions {
                let [a, b] = matches(motion, 40, 40, seed);
                let v = verify_two_views(&camera(), &a, &b, &config, seed).unwrap();
                let right = v.inliers[..40].iter().filter(|i| **i).count();
                assert!(right >= 34, "seed {seed}: {right}");
                assert!(v.log10_false_alarms < -10.0, "seed {seed}: {}", v.log10_false_alarms);
            }
            for n in [8, 20, 80, 300] {
                let [a, b] = matches(&motions[0], 0, n, seed);
                let v = verify_two_views(&camera(), &a, &b, &config, seed).unwrap();
                assert!(v.log10_false_alarms > -2.0, "seed {seed}, {n}: {}", v.log10_false_alarms);
            }
        }
        assert!(verify_two_views(&camera(), &[[0.0; 2]; 7], &[[0.0; 2]; 7], &config, 0).is_none());
    }
}
