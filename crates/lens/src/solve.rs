//! The lens with everything that it is coupled to, by Levenberg-Marquardt on all of it at once ([`Joint`]).
//!
//! A search over the lens alone, with an adjustment of poses and landmarks for each lens that is looked at, needs these
//! adjustments to be exact: along a straight walk they are not after dozens of steps, and then its derivatives are wrong.

use crate::joint::Joint;
use crate::model::Lens;
use crate::problem::LensProblem;
use cairn_solve::{Convergence, Damping, LevenbergMarquardt, pause, to_end};

/// Steps at most, and the decrease of the cost that ends them, as a part of it.
const STEPS: usize = 200;
const TOLERANCE: f64 = 1e-7;
/// Converged where the lens would move by less than this share of its standard deviation.
const LEFT: f64 = 0.5;

/// An estimated lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensEstimate {
    /// The lens.
    pub lens: Lens,
    /// Standard deviations of focal length (relative) and distortion: from the residuals as they are, were each independent of the
    /// others, or from how far the stretches of the walk pull the lens apart, whichever is larger.
    pub sigma: [f64; 2],
    /// Seconds to add to the gyroscope's stamps, and those from the exposure of the first row to that of the last, each with its
    /// standard deviation.
    pub offset_s: [f64; 2],
    /// See `offset_s`.
    pub readout_s: [f64; 2],
    /// Root mean square of the residuals, pixels at the finest level.
    pub rms_px: f64,
    /// Whether nothing moves the lens any more.
    pub converged: bool,
}

impl LensProblem {
    /// Estimates the lens; `None` where nothing determines it.
    pub fn solve(&self) -> Option<LensEstimate> {
        to_end(self.solve_in_slices())
    }

    /// The same in slices.
    pub async fn solve_in_slices(&self) -> Option<LensEstimate> {
        let mut joint = Joint::new(self);
        pause().await;
        let solver = LevenbergMarquardt {
            iterations: STEPS,
            damping: Damping::Factors {
                first: 1e-5,
                least: 1e-9,
                most: 1e6,
                shrink: 0.2,
                grow: 10.0,
                restart: 0.0,
            },
            convergence: Convergence::Actual { relative: TOLERANCE },
        };
        solver.minimise_in_slices(&mut joint, || false).await;
        let lens = joint.state.optics.lens;
        if !(lens.focal.is_finite() && lens.radial.is_finite()) {
            return None;
        }
        let left = joint.left()?;
        let variance = self.bundle.residual_variance(joint.observation_cost(&joint.state));
        let independent = |k: usize| (left.covariance[(k, k)] * variance.max(1e-12)).max(0.0).sqrt();
        let converged = (0..2).all(|k| left.step[k].abs() < LEFT * independent(k));
        let sigma = |k: usize| independent(k).max(left.disagreement[(k, k)].sqrt());
        let [offset_s, readout_s] = self.taken_with_s;
        Some(LensEstimate {
            lens,
            sigma: [0, 1].map(sigma),
            // Readings that are to be taken later have later stamps than the images.
            offset_s: [offset_s - joint.state.clock.late_s, sigma(3)],
            readout_s: [readout_s + joint.state.optics.readout_s, sigma(2)],
            rms_px: variance.sqrt(),
            converged,
        })
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::GyroLink;
    use cairn_geometry::{Se3, So3, Vec2, Vec3};
    use cairn_random::Random;
    use cairn_sensor::{Camera, Distortion};
    use cairn_solve::{Bundle, Freedom, Observation, Pinhole};

    const BIAS: f64 = 0.01;

    /// A walk of some metres that turns by `turn` radians, through points around; seen by a true camera, given in the
    /// pixels of a guess whose poses and points are rough.
    pub(crate) fn problem(true_camera: &Camera, turn: f64, gyro: bool, seed: u64) -> LensProblem {
        let mut random = Random::new(seed);
        let count = 40;
        let truth: Vec<Se3> = (0..count)
            .map(|i| {
                let t = i as f64 / count as f64;
                let heading = turn * (3.0 * (t - 0.33)).clamp(0.0, 1.0);
                let sway = 0.03 * (1.9 * i as f64).sin();
                let place = Vec3::new(1.5 * (heading).sin() + sway, 0.02 * (2.3 * i as f64).cos(), 5.0 * t);
                Se3::new(So3::exp(&Vec3::new(0.02 * sway, heading, 0.01 * (i as f64).sin())), place)
            })
            .collect();
        let guess = Pinhole { fx: 448.0, fy: 448.0, cx: 319.5, cy: 239.5, baseline_fx: 0.0 };
        let (mut points, mut observations) = (Vec::new(), Vec::new());
        while points.len() < 700 {
            let p =
                Vec3::new(random.uniform(-5.0, 9.0), random.uniform(-2.0, 2.0), random.uniform(0.0, 12.0));
            let first = observations.len();
            for (i, pose) in truth.iter().enumerate() {
                let q = pose.inverse() * p;
                let Some(px) = true_camera.project(&q).filter(|px| q.z > 0.8 && true_camera.contains(px))
                else {
                    continue;
                };
                let mut noise = || 0.5 * random.standard_normal();
                let pixel = [px.x + noise(), px.y + noise(), f64::NAN];
                observations.push(Observation {
                    pose: i as u32,
                    point: points.len() as u32,
                    pixel,
                    weight: 1.0,
                });
            }
            if observations.len() - first < 3 {
                observations.truncate(first);
            } else {
                points.push(p + Vec3::new(1.0, 1.0, 1.0) * (0.05 * random.standard_normal()));
            }
        }
        let links = (1..count).filter(|_| gyro).map(|to| {
            let turned = truth[to - 1].rotation.inverse() * truth[to].rotation;
            let mut wrong = || BIAS * 0.3 + 1e-3 * random.standard_normal();
            let rotation = turned * So3::exp(&Vec3::new(wrong(), wrong(), wrong()));
            let rates = [-1, 1].map(|side| Vec3::new(0.1, 0.4, -0.2) * f64::from(side));
            GyroLink { from: to - 1, to, rotation, rates, seconds: 0.3, sigma: 3e-3 }
        });
        let links = links.collect();
        let mut freedom = vec![Freedom::Free; count];
        freedom[0] = Freedom::Fixed;
        let bundle = Bundle {
            camera: guess,
            own_cameras: Vec::new(),
            poses: truth,
            freedom,
            points,
            observations,
            calibrations: Vec::new(),
        };
        // Rows lower in the picture are exposed later: a camera that turns to the right sees them farther left.
        let slopes = bundle.observations.iter().map(|o| Vec2::new((o.pixel[1] - 240.0) * 0.5, 0.0)).collect();
        LensProblem { bundle, slopes, links, taken_with_s: [0.0; 2] }
    }

    pub(crate) fn camera(focal: f64, k1: f64) -> Camera {
        Camera {
            distortion: Distortion::RadialTangential([k1, 0.0, 0.0, 0.0, 0.0]),
            ..Camera::pinhole(640, 480, focal, focal, 319.5, 239.5)
        }
    }

    #[test]
    fn lens_is_found_within_its_stated_uncertainty() {
        for (seed, focal, k1) in [(1, 540.0, -0.04), (2, 430.0, 0.05), (3, 505.0, 0.0)] {
            let truth = camera(focal, k1);
            let found = problem(&truth, 1.3, true, seed).solve().unwrap();
            assert!(found.converged, "{found:?}");
            assert!((problem(&truth, 1.3, true, seed).turned_rad() - 1.3).abs() < 0.05);
            let ratio = focal / 448.0;
            let error = (found.lens.focal / ratio).ln();
            assert!(found.sigma[0] < 5e-3 && error.abs() < 4.0 * found.sigma[0] + 2e-3, "{focal}: {found:?}");
            // A ray through the corner is right to a third of a pixel.
            let guess = Camera::pinhole(640, 480, 448.0, 448.0, 319.5, 239.5);
            let estimated = found.lens.camera(&guess);
            let px = Vec2::new(560.0, 420.0);
            let (a, b) = (truth.unproject(&px).unwrap(), estimated.unproject(&px).unwrap());
            assert!(a.angle(&b) < 4e-3, "{focal} {k1}: {} in {found:?}", a.angle(&b));
            assert!((0.3..0.8).contains(&found.rms_px), "{found:?}");
        }
    }

    /// Pictures err alike while a walker turns or steps (rows exposed one after the other, late stamps): his lens is then known less
    /// well than by as many independent residuals, and that is said.
    #[test]
    fn errors_that_last_for_some_pictures_are_in_the_stated_uncertainty() {
        let truth = camera(500.0, 0.0);
        let (mut stated, mut independent) = (0.0, 0.0);
        let seeds = 10..22u32;
        let count = seeds.len() as f64;
        for seed in seeds {
            let mut p = problem(&truth, 1.3, true, u64::from(seed));
            let mut random = Random::new(u64::from(seed) ^ 0x7EA4);
            let wrong: Vec<f64> = (0..8).map(|_| 0.006 * random.standard_normal()).collect();
            for o in &mut p.bundle.observations {
                let skew = wrong[o.pose as usize / 5];
                o.pixel[0] += skew * (o.pixel[1] - p.bundle.camera.cy);
                o.pixel[1] += skew * (o.pixel[1] - p.bundle.camera.cy);
            }
            let found = p.solve().unwrap();
            let error = (found.lens.focal * 448.0 / 500.0).ln();
            let mut joint = Joint::new(&p);
            joint.state.optics.lens = found.lens;
            let alone = joint.left().unwrap().covariance[(0, 0)].sqrt() * found.rms_px;
            stated += (error / found.sigma[0]).powi(2) / count;
            independent += (error / alone).powi(2) / count;
        }
        let [stated, independent] = [stated, independent].map(f64::sqrt);
        println!(
            "errors in standard deviations: {stated:.2} of those stated, {independent:.2} of independent residuals"
        );
        assert!(independent > 2.0 && stated < 1.6, "{stated} {independent}");
    }

    #[test]
    fn offset_and_readout_are_what_has_to_be_added_to_stamps_and_to_the_readout_in_use() {
        for (seed, offset_s, readout_s) in [(5, 0.015, -0.01), (6, -0.02, 0.012)] {
            let mut p = problem(&camera(448.0, 0.0), 1.3, true, seed);
            p.taken_with_s = [0.03, 0.02];
            for link in &mut p.links {
                // A reading is of a moment that much after its stamp.
                let [before, after] = link.rates.map(|rate| So3::exp(&(rate * offset_s)));
                link.rotation = before.inverse() * link.rotation * after;
            }
            for (o, slope) in p.bundle.observations.iter_mut().zip(&p.slopes) {
                (o.pixel[0], o.pixel[1]) =
                    (o.pixel[0] - readout_s * slope.x, o.pixel[1] - readout_s * slope.y);
            }
            let found = p.solve().unwrap();
            let off = [found.offset_s[0] - 0.03 - offset_s, found.readout_s[0] - 0.02 - readout_s];
            let most = [found.offset_s[1], found.readout_s[1]].map(|sigma| 2.0 * sigma);
            assert!(
                (0..2).all(|k| off[k].abs() < most[k] && most[k] < 0.0125),
                "{off:?} of {offset_s} {readout_s}: {found:?}"
            );
        }
    }

    /// Straight ahead and without a gyroscope the focal length is not seen: that is said by a large standard deviation.
    #[test]
    fn what_is_not_seen_is_not_claimed() {
        let straight = problem(&camera(540.0, 0.0), 0.0, false, 4).solve();
        let turning = problem(&camera(540.0, 0.0), 1.3, true, 4).solve().unwrap();
        assert!(straight.is_none_or(|s| s.sigma[0] > 5.0 * turning.sigma[0]), "{straight:?} {turning:?}");
    }
}
