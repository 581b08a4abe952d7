//! The lens by variable projection: for each lens all poses and landmarks are adjusted, and what is left is a function of
//! two numbers whose gradient needs no derivative of the adjustment (Golub and Pereyra 1973, "The differentiation of
//! pseudo-inverses and nonlinear least squares problems whose variables separate"). Newton's method on those two.
//!
//! Residuals are in pixels as measured: with the lens `(s, c)` and a landmark at `X` in the camera,
//! `r = d (1 + c rho^2) - s f X_xy / X_z`, which is `s` times the residual of the ideal pinhole of the guessed focal length.

use crate::gyro::GyroFactors;
use crate::model::Lens;
use crate::problem::LensProblem;
use cairn_geometry::Vec2;
use cairn_solve::{Bundle, BundleConfig, huber};
use nalgebra::{Matrix2, Vector2};

/// Standard deviations of the guess: of the logarithm of the focal length, and of the distortion.
const PRIOR: [f64; 2] = [0.2, 0.1];
/// Steps from the lens at which the gradient is taken again, for the second derivatives.
const APART: [f64; 2] = [0.01, 0.01];
/// Longest Newton step of each number.
const LONGEST: [f64; 2] = [0.08, 0.06];
/// Newton steps at most; converged when both numbers move by less than `CONVERGED`.
const STEPS: usize = 8;
const CONVERGED: f64 = 2e-4;

/// An estimated lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LensEstimate {
    /// The lens.
    pub lens: Lens,
    /// Standard deviations of focal length (relative) and distortion, from the residuals as they are.
    pub sigma: [f64; 2],
    /// Root mean square of the residuals, pixels at the finest level.
    pub rms_px: f64,
    /// Whether the Newton steps became small.
    pub converged: bool,
}

/// The problem adjusted for one lens.
#[derive(Clone)]
struct Adjusted {
    bundle: Bundle,
    gyro: GyroFactors,
    gradient: Vector2<f64>,
}

impl LensProblem {
    /// Estimates the lens; `None` where nothing determines it.
    pub fn solve(&self) -> Option<LensEstimate> {
        let gyro = GyroFactors::new(self.links.clone());
        let mut lens = Lens::GUESS;
        let mut at = self.adjusted(&lens, &self.bundle, &gyro);
        let mut converged = false;
        let mut hessian = Matrix2::zeros();
        for _ in 0..STEPS {
            hessian = self.hessian(&lens, &at)?;
            let step = -(hessian.try_inverse()? * at.gradient);
            let step =
                Vector2::new(step[0].clamp(-LONGEST[0], LONGEST[0]), step[1].clamp(-LONGEST[1], LONGEST[1]));
            lens = Lens { focal: lens.focal * step[0].exp(), radial: lens.radial + step[1] };
            at = self.adjusted(&lens, &at.bundle, &at.gyro);
            converged = step.amax() < CONVERGED;
            if converged {
                break;
            }
        }
        if !(lens.focal.is_finite() && lens.radial.is_finite()) {
            return None;
        }
        let cost = at.bundle.observation_cost(true);
        let variance = at.bundle.residual_variance(cost);
        let covariance = hessian.try_inverse()? * variance.max(1e-12);
        let sigma = [covariance[(0, 0)], covariance[(1, 1)]].map(|v| v.max(0.0).sqrt());
        Some(LensEstimate { lens, sigma, rms_px: variance.sqrt(), converged })
    }

    /// Poses and landmarks adjusted for a lens, from a state nearby, and the gradient of the cost by the lens.
    fn adjusted(&self, lens: &Lens, from: &Bundle, gyro: &GyroFactors) -> Adjusted {
        let mut bundle = from.clone();
        let measured = &self.bundle.observations;
        for (o, m) in bundle.observations.iter_mut().zip(measured) {
            o.pixel = lens.ideal(&self.bundle.camera, &m.pixel);
            o.weight = m.weight * lens.focal.powi(2);
        }
        let mut gyro = gyro.clone();
        let config = BundleConfig { iterations: 25, tolerance: 1e-6, ..BundleConfig::default() };
        bundle.solve_with(&mut gyro, &config, || false);
        let gradient = self.gradient(lens, &bundle);
        Adjusted { bundle, gyro, gradient }
    }

    /// The cost's derivative by the logarithm of the focal length and by the distortion, poses and landmarks held: at their
    /// best that is the whole derivative.
    fn gradient(&self, lens: &Lens, at: &Bundle) -> Vector2<f64> {
        let camera = &self.bundle.camera;
        let mut g = Vector2::new(lens.focal.ln() / PRIOR[0].powi(2), lens.radial / PRIOR[1].powi(2));
        let views: Vec<_> = at.poses.iter().map(|p| p.inverse()).collect();
        for (o, m) in at.observations.iter().zip(&self.bundle.observations) {
            let q = views[o.pose as usize] * at.points[o.point as usize];
            if o.weight <= 0.0 || q.z < 1e-3 {
                continue;
            }
            let d = Vec2::new(m.pixel[0] - camera.cx, m.pixel[1] - camera.cy);
            let seen = Vec2::new(camera.fx * q.x / q.z, camera.fy * q.y / q.z) * lens.focal;
            let rho = lens.rho_squared(camera, &d);
            let r = lens.stretched(camera, &d) - seen;
            let (_, slope) = huber(r.norm_squared() * m.weight, Bundle::bound(o));
            let w = m.weight * slope;
            g[0] += w * r.dot(&(d * (-2.0 * lens.radial * rho) - seen));
            g[1] += w * r.dot(&(d * rho));
        }
        g
    }

    /// Second derivatives, by gradients of adjustments a little apart; `None` where they are not positive definite.
    fn hessian(&self, lens: &Lens, at: &Adjusted) -> Option<Matrix2<f64>> {
        let shifted = [
            Lens { focal: lens.focal * APART[0].exp(), ..*lens },
            Lens { radial: lens.radial + APART[1], ..*lens },
        ];
        let mut h = Matrix2::zeros();
        for (k, lens) in shifted.iter().enumerate() {
            let there = self.adjusted(lens, &at.bundle, &at.gyro);
            h.set_column(k, &((there.gradient - at.gradient) / APART[k]));
        }
        let h = 0.5 * (h + h.transpose());
        (h[(0, 0)] > 0.0 && h.determinant() > 0.0).then_some(h)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::GyroLink;
    use cairn_geometry::{Se3, So3, Vec3};
    use cairn_random::Random;
    use cairn_sensor::{Camera, Distortion};
    use cairn_solve::{Freedom, Observation, Pinhole, RightOffset};

    const BIAS: f64 = 0.01;

    /// A walk of some metres that turns by `turn` radians, through points around; seen by a true camera, given in the
    /// pixels of a guess whose poses and points are rough.
    fn problem(true_camera: &Camera, turn: f64, gyro: bool, seed: u64) -> LensProblem {
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
            GyroLink { from: to - 1, to, rotation, seconds: 0.3, sigma: 3e-3 }
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
            right_offset: RightOffset::default(),
        };
        LensProblem { bundle, links }
    }

    fn camera(focal: f64, k1: f64) -> Camera {
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

    /// Straight ahead and without a gyroscope the focal length is not seen: that is said by a large standard deviation.
    #[test]
    fn what_is_not_seen_is_not_claimed() {
        let straight = problem(&camera(540.0, 0.0), 0.0, false, 4).solve();
        let turning = problem(&camera(540.0, 0.0), 1.3, true, 4).solve().unwrap();
        assert!(straight.is_none_or(|s| s.sigma[0] > 5.0 * turning.sigma[0]), "{straight:?} {turning:?}");
    }

    #[test]
    fn gradient_is_the_derivative_of_the_adjusted_cost() {
        let p = problem(&camera(500.0, 0.03), 1.0, true, 5);
        let gyro = GyroFactors::new(p.links.clone());
        let cost = |lens: &Lens, from: &Adjusted| {
            let a = p.adjusted(lens, &from.bundle, &from.gyro);
            let prior = (lens.focal.ln() / PRIOR[0]).powi(2) + (lens.radial / PRIOR[1]).powi(2);
            a.bundle.observation_cost(true) + a.gyro.cost(&a.bundle.poses, &a.gyro.bias) + 0.5 * prior
        };
        let lens = Lens { focal: 1.05, radial: 0.01 };
        let first = p.adjusted(&lens, &p.bundle, &gyro);
        let at = p.adjusted(&lens, &first.bundle, &first.gyro);
        let h = 1e-3;
        let up = cost(&Lens { focal: lens.focal * f64::exp(h), ..lens }, &at);
        let down = cost(&Lens { focal: lens.focal * f64::exp(-h), ..lens }, &at);
        let difference = (up - down) / (2.0 * h);
        assert!((difference / at.gradient[0] - 1.0).abs() < 0.03, "{difference} {}", at.gradient[0]);
        let up = cost(&Lens { radial: lens.radial + h, ..lens }, &at);
        let down = cost(&Lens { radial: lens.radial - h, ..lens }, &at);
        let difference = (up - down) / (2.0 * h);
        assert!((difference / at.gradient[1] - 1.0).abs() < 0.03, "{difference} {}", at.gradient[1]);
    }
}
