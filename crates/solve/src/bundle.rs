//! Bundle adjustment: poses of ideal pinholes and points, by Levenberg-Marquardt on the reduced camera
//! system, which is solved sparsely.
//!
//! Source: Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6; damping after
//! Nielsen, "Damping parameter in Marquardt's method" (1999).

use crate::reprojection::View;
use crate::schur::{Border, Normal, Schur, Step};
use crate::{CHI2_2, CHI2_3, Pinhole, Pixel, Report, Stop, huber};
use cairn_geometry::{Manifold, Mat3, Se3, Vec3};
use nalgebra::{SMatrix, SVector};

/// One point seen from one pose.
#[derive(Clone, Copy, Debug)]
pub struct Observation {
    /// Index of the pose.
    pub pose: u32,
    /// Index of the point.
    pub point: u32,
    /// Where it is seen.
    pub pixel: Pixel,
    /// Inverse variance, 1/px^2; 0 leaves the observation out.
    pub weight: f64,
}

/// What is added to every diagonal entry of the normal equations, so that what nothing holds stays.
const FLOOR: f64 = 1e-8;

/// The problem and, after [`Bundle::solve`], its solution.
#[derive(Clone, Debug)]
pub struct Bundle {
    /// The camera of all poses.
    pub camera: Pinhole,
    /// `world_from_camera` of each pose.
    pub poses: Vec<Se3>,
    /// Poses that stay.
    pub fixed: Vec<bool>,
    /// Points in the world, metres.
    pub points: Vec<Vec3>,
    /// Observations, grouped by point: all of a point stand together.
    pub observations: Vec<Observation>,
    /// What is added to every measured right x, pixels: the error of the stereo calibration that looks like disparity.
    pub right_offset: f64,
    /// What is known of that offset beforehand, pixels,
    pub right_offset_before: f64,
    /// and its standard deviation, when it is to be found; 0 keeps it as it is.
    pub right_offset_sigma: f64,
    /// True to ask only where the offset would move: it stays as it is, and so does what it would move.
    pub right_offset_held: bool,
    /// How far the offset would move, or moved, in the first step of [`Bundle::solve`], pixels.
    pub right_offset_pull: f64,
    /// What is known of the offset, prior and observations together, where [`Bundle::solve`] began (and with its
    /// first damping, a hundred-thousandth of the diagonal): 1/px^2.
    pub right_offset_information: f64,
}

/// How to solve.
#[derive(Clone, Copy, Debug)]
pub struct BundleConfig {
    /// Steps at most, rejected ones too.
    pub iterations: usize,
    /// Whether Huber's loss is used.
    pub robust: bool,
    /// Stop when a step lowers the cost by less than this part of it.
    pub tolerance: f64,
}

impl Default for BundleConfig {
    fn default() -> Self {
        Self { iterations: 10, robust: true, tolerance: 1e-4 }
    }
}

/// The undamped normal equations at one state.
struct Linear {
    normal: Normal<6>,
    /// Of the right offset, when it is to be found.
    border: Option<Border<6>>,
}

impl Bundle {
    /// Squared whitened residual of an observation; infinite behind the eye.
    pub fn chi2(&self, o: &Observation) -> f64 {
        let q = View::new(&self.poses[o.pose as usize]).to_camera(&self.points[o.point as usize]);
        match self.camera.residual(&q, &shifted(&o.pixel, self.right_offset)) {
            Some(r) => (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight,
            None => f64::INFINITY,
        }
    }

    /// Variance of the residuals at a cost, in units of what the weights say; 1 where the unknowns could take up all of them.
    pub fn residual_variance(&self, cost: f64) -> f64 {
        let used = self.observations.iter().filter(|o| o.weight > 0.0);
        let rows: usize = used.map(|o| if o.pixel[2].is_nan() { 2 } else { 3 }).sum();
        let unknowns = 6 * self.fixed.iter().filter(|fixed| !**fixed).count() + 3 * self.points.len();
        let variance = 2.0 * cost / (rows as f64 - unknowns as f64);
        if rows > unknowns && variance > 0.0 { variance } else { 1.0 }
    }

    /// The 95 % bound of an observation's chi-square.
    pub fn bound(o: &Observation) -> f64 {
        if o.pixel[2].is_nan() { CHI2_2 } else { CHI2_3 }
    }

    /// Lowers the cost; asks `stop` before each step.
    pub fn solve(&mut self, config: &BundleConfig, mut stop: impl FnMut() -> bool) -> Report {
        let slot = self.slots();
        let free = slot.iter().flatten().count();
        let mut report =
            Report { iterations: 0, cost_before: 0.0, cost_after: 0.0, inliers: 0, stop: Stop::Empty };
        if self.observations.is_empty() || (free == 0 && self.points.is_empty()) {
            return report;
        }
        let mut schur = Schur::new(
            free,
            self.points.len(),
            self.observations.iter().map(|o| (o.point as usize, slot[o.pose as usize])),
        );
        let mut linear = self.linearise(&slot, free, config.robust);
        let mut cost_now = linear.normal.cost;
        report.cost_before = cost_now;
        report.stop = Stop::Iterations;
        let (mut lambda, mut growth) = (1e-5, 2.0);
        while report.iterations < config.iterations {
            if stop() {
                report.stop = Stop::Interrupted;
                break;
            }
            report.iterations += 1;
            let step = schur.step(&linear.normal, linear.border.as_ref(), lambda, FLOOR);
            if let (1, Some(step)) = (report.iterations, &step) {
                // Later steps may be damped much more, which looks like information.
                self.right_offset_information = step.border_information;
                self.right_offset_pull = step.border_pull;
            }
            let accepted = step.and_then(|step| {
                let offset = self.right_offset + step.border;
                let (poses, points) = self.moved(&slot, &step);
                let cost = self.cost(&poses, &points, offset, config.robust);
                (cost < cost_now && cost.is_finite()).then_some((poses, points, offset, cost))
            });
            match accepted {
                Some((poses, points, offset, cost)) => {
                    self.right_offset = offset;
                    let gain = (cost_now - cost) / cost_now;
                    cost_now = cost;
                    self.poses = poses;
                    self.points = points;
                    (lambda, growth) = ((lambda / 5.0).max(1e-9), 2.0);
                    if gain < config.tolerance {
                        report.stop = Stop::Converged;
                        break;
                    }
                    if report.iterations < config.iterations {
                        linear = self.linearise(&slot, free, config.robust);
                    }
                }
                None => {
                    lambda *= growth * 5.0;
                    growth *= 2.0;
                    if lambda > 1e6 {
                        report.stop = Stop::NoDescent;
                        break;
                    }
                }
            }
        }
        report.cost_after = cost_now;
        report.inliers =
            self.observations.iter().filter(|o| o.weight > 0.0 && self.chi2(o) <= Self::bound(o)).count();
        report
    }

    /// For each pose its place among the free ones.
    fn slots(&self) -> Vec<Option<u32>> {
        let mut next = 0;
        self.fixed
            .iter()
            .map(|fixed| {
                (!fixed).then(|| {
                    next += 1;
                    next - 1
                })
            })
            .collect()
    }

    fn finds_offset(&self) -> bool {
        self.right_offset_sigma > 0.0
    }

    /// Information of the offset's prior, 1/px^2.
    fn offset_information(&self) -> f64 {
        if self.finds_offset() { self.right_offset_sigma.powi(-2) } else { 0.0 }
    }

    fn cost(&self, poses: &[Se3], points: &[Vec3], offset: f64, robust: bool) -> f64 {
        let views: Vec<View> = poses.iter().map(View::new).collect();
        let mut cost = 0.5 * self.offset_information() * (offset - self.right_offset_before).powi(2);
        for o in self.observations.iter().filter(|o| o.weight > 0.0) {
            let q = views[o.pose as usize].to_camera(&points[o.point as usize]);
            let Some(r) = self.camera.residual(&q, &shifted(&o.pixel, offset)) else { return f64::INFINITY };
            let chi2 = (r[0] * r[0] + r[1] * r[1] + r[2] * r[2]) * o.weight;
            cost += 0.5 * if robust { huber(chi2, Self::bound(o)).0 } else { chi2 };
        }
        cost
    }

    fn linearise(&mut self, slot: &[Option<u32>], free: usize, robust: bool) -> Linear {
        let views: Vec<View> = self.poses.iter().map(View::new).collect();
        let mut normal = Normal::<6>::zeros(free, self.points.len(), self.observations.len());
        let (offset, information) = (self.right_offset, self.offset_information());
        let mut border = self.finds_offset().then(|| Border {
            hessian: information,
            gradient: information * (offset - self.right_offset_before),
            cameras: vec![SVector::zeros(); free],
            points: vec![Vec3::zeros(); self.points.len()],
            held: self.right_offset_held,
        });
        normal.cost = 0.5 * information * (offset - self.right_offset_before).powi(2);
        for (o, coupling) in self.observations.iter_mut().zip(&mut normal.couplings) {
            if o.weight <= 0.0 {
                continue;
            }
            let point = o.point as usize;
            let pixel = shifted(&o.pixel, offset);
            let Some(l) = self.camera.linearise(&views[o.pose as usize], &self.points[point], &pixel) else {
                // A point behind an eye can not be adjusted to it: out it goes.
                o.weight = 0.0;
                continue;
            };
            let r = Vec3::from(l.residual);
            let chi2 = r.norm_squared() * o.weight;
            let (loss, slope) = if robust { huber(chi2, Self::bound(o)) } else { (chi2, 1.0) };
            normal.cost += 0.5 * loss;
            let w = slope * o.weight;
            // Rows of the Jacobians are held as columns here.
            let by_point = Mat3::from_columns(&l.by_point.map(Vec3::from));
            normal.points[point] += by_point * by_point.transpose() * w;
            normal.point_gradients[point] += by_point * r * w;
            let slot = slot[o.pose as usize].map(|s| s as usize);
            if let (Some(border), false) = (&mut border, o.pixel[2].is_nan()) {
                // Only the third row feels the offset, with slope one.
                border.hessian += w;
                border.gradient += w * r[2];
                border.points[point] += Vec3::from(l.by_point[2]) * w;
                if let Some(s) = slot {
                    border.cameras[s] += SVector::<f64, 6>::from(l.by_pose[2]) * w;
                }
            }
            if let Some(s) = slot {
                let by_pose = SMatrix::<f64, 6, 3>::from_columns(&l.by_pose.map(SVector::<f64, 6>::from));
                let weighted = by_pose * w;
                normal.cameras[s] += weighted * by_pose.transpose();
                normal.camera_gradients[s] += weighted * r;
                *coupling = weighted * by_point.transpose();
            }
        }
        Linear { normal, border }
    }

    /// The state after a step.
    fn moved(&self, slot: &[Option<u32>], step: &Step<6>) -> (Vec<Se3>, Vec<Vec3>) {
        let poses = self.poses.iter().zip(slot).map(|(pose, slot)| match slot {
            Some(k) => pose.retract(&step.cameras[*k as usize]),
            None => *pose,
        });
        (poses.collect(), self.points.iter().zip(&step.points).map(|(p, d)| p + d).collect())
    }
}

/// A pixel with an offset added to its right x.
fn shifted(pixel: &Pixel, offset: f64) -> Pixel {
    [pixel[0], pixel[1], pixel[2] + offset]
}

#[cfg(test)]
mod tests {
    use super::*;
    use cairn_geometry::So3;

    /// Eyes on an arc around a cloud, stereo pixels without noise; the state is disturbed.
    fn disturbed() -> (Bundle, Vec<Se3>) {
        let camera = Pinhole { fx: 500.0, fy: 500.0, cx: 320.0, cy: 240.0, baseline_fx: 50.0 };
        let mut bundle = Bundle {
            camera,
            poses: vec![],
            fixed: vec![],
            points: vec![],
            observations: vec![],
            right_offset: 0.0,
            right_offset_before: 0.0,
            right_offset_sigma: 0.0,
            right_offset_held: false,
            right_offset_pull: 0.0,
            right_offset_information: 0.0,
        };
        let truth: Vec<Se3> = (0..6)
            .map(|i| {
                Se3::new(
                    So3::exp(&Vec3::new(0.0, 0.05 * i as f64, 0.0)),
                    Vec3::new(-0.3 * i as f64, 0.02, 0.0),
                )
            })
            .collect();
        for (i, pose) in truth.iter().enumerate() {
            let e = 0.01 * i as f64;
            bundle.poses.push(*pose * Se3::new(So3::exp(&Vec3::new(e, -e, 0.5 * e)), Vec3::new(e, e, -e)));
            bundle.fixed.push(i == 0);
        }
        bundle.poses[0] = truth[0];
        for j in 0..80u32 {
            let a = j as f64;
            let p = Vec3::new((a * 0.9).sin() * 2.0, (a * 1.7).cos(), 5.0 + (a * 0.31).sin());
            for (i, pose) in truth.iter().enumerate() {
                let q = pose.inverse() * p;
                let u = camera.fx * q.x / q.z + camera.cx;
                let right = if j % 2 == 0 { u - camera.baseline_fx / q.z } else { f64::NAN };
                let pixel = [u, camera.fy * q.y / q.z + camera.cy, right];
                bundle.observations.push(Observation { pose: i as u32, point: j, pixel, weight: 1.0 });
            }
            bundle.points.push(p + Vec3::new(0.03, -0.02, 0.05) * (a * 2.3).sin());
        }
        (bundle, truth)
    }

    #[test]
    fn returns_to_the_truth() {
        let (mut bundle, truth) = disturbed();
        let config = BundleConfig { iterations: 20, robust: true, tolerance: 1e-12 };
        let report = bundle.solve(&config, || false);
        assert!(report.cost_after < 1e-8 * report.cost_before, "{report:?}");
        for (found, truth) in bundle.poses.iter().zip(&truth) {
            assert!(found.local(truth).norm() < 1e-5);
        }
    }

    #[test]
    fn what_is_known_of_the_disparity_counts_and_its_information_is_the_curvature() {
        let config = BundleConfig { iterations: 60, robust: false, tolerance: 1e-15 };
        let off = |before: f64, sigma: f64| {
            let (mut bundle, truth) = disturbed();
            bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
            // Two eyes that stand a known way apart tell scale, against which damping is little.
            (bundle.poses[5], bundle.fixed[5]) = (truth[5], true);
            (bundle.right_offset, bundle.right_offset_before) = (before, before);
            bundle.right_offset_sigma = sigma;
            bundle.solve(&config, || false);
            let cost = bundle.solve(&BundleConfig { iterations: 1, ..config }, || false).cost_after;
            (bundle.right_offset, bundle.right_offset_information, cost)
        };
        let (held, ..) = off(0.1, 1e-6);
        assert!((held - 0.1).abs() < 1e-3, "{held}");
        let (found, information, least) = off(0.1, 1e3);
        assert!((found - 0.3).abs() < 1e-3, "{found}");
        // Held off the best by d, all else free, it costs half the information times d squared.
        let d = 0.01;
        let (_, _, cost) = off(found + d, 0.0);
        let curvature = (cost - least) / (0.5 * d * d);
        assert!((information / curvature - 1.0).abs() < 0.05, "{information} against {curvature}");
    }

    #[test]
    fn a_wrong_disparity_shows_and_is_found() {
        let (mut bundle, truth) = disturbed();
        for o in &mut bundle.observations {
            o.pixel[2] -= 0.3;
        }
        // Hardly a prior: the data alone shall tell.
        bundle.right_offset_sigma = 1000.0;
        let config = BundleConfig { iterations: 40, robust: true, tolerance: 1e-14 };
        let report = bundle.solve(&config, || false);
        assert!((bundle.right_offset - 0.3).abs() < 1e-3, "{} {report:?}", bundle.right_offset);
        assert!(bundle.poses.iter().zip(&truth).all(|(found, truth)| found.local(truth).norm() < 1e-3));
    }

    #[test]
    fn a_disparity_that_is_held_is_asked_about_and_moves_nothing() {
        let config = BundleConfig { iterations: 40, robust: false, tolerance: 1e-14 };
        let with = |sigma: f64, held: bool| {
            let (mut bundle, truth) = disturbed();
            bundle.observations.iter_mut().for_each(|o| o.pixel[2] -= 0.3);
            (bundle.poses[5], bundle.fixed[5]) = (truth[5], true);
            (bundle.right_offset_sigma, bundle.right_offset_held) = (sigma, held);
            bundle.solve(&config, || false);
            // Once more from where it is solved: there the linear model tells what is asked.
            bundle.solve(&config, || false);
            bundle
        };
        let (without, held, free) = (with(0.0, false), with(1e3, true), with(1e3, false));
        assert_eq!(held.right_offset, 0.0);
        assert!(held.poses.iter().zip(&without.poses).all(|(a, b)| a.local(b).norm() < 1e-9));
        assert!((held.right_offset_pull - 0.3).abs() < 0.01, "{}", held.right_offset_pull);
        assert!((held.right_offset_information / free.right_offset_information - 1.0).abs() < 0.1);
        assert!(free.right_offset_pull.abs() < 1e-4, "{}", free.right_offset_pull);
    }

    #[test]
    fn an_interrupt_keeps_the_state_usable() {
        let (mut bundle, _) = disturbed();
        let mut calls = 0;
        let report = bundle.solve(&BundleConfig::default(), || {
            calls += 1;
            calls > 2
        });
        assert_eq!(report.stop, Stop::Interrupted);
        assert!(report.cost_after < report.cost_before);
    }

    #[test]
    fn a_point_behind_an_eye_is_left_out() {
        let (mut bundle, _) = disturbed();
        bundle.points[3] = Vec3::new(0.0, 0.0, -5.0);
        let report = bundle.solve(&BundleConfig::default(), || false);
        assert!(report.cost_after.is_finite() && report.cost_after < report.cost_before);
    }
}
