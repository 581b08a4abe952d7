//! The lens, the gyroscope's bias, all poses and all landmarks as one least-squares problem, for the one Levenberg-Marquardt
//! loop. The landmarks are eliminated (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6); what is left is
//! some hundred unknowns, of which each pair is coupled by the lens, and is solved densely.
//!
//! Residuals are in pixels as measured: with the lens `(s, c)` and a landmark at `X` in the camera,
//! `r = d (1 + c rho^2) - s f X_xy / X_z`.

use crate::gyro::{BIAS_SIGMA, residual};
use crate::model::Lens;
use crate::problem::LensProblem;
use cairn_geometry::{Manifold, Mat3, Se3, So3, Vec2, Vec3};
use cairn_solve::{Bundle, Observation, Problem, Trial, huber, pause, to_end};
use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2, MatrixXx2, SMatrix, SVector, Vector2};

/// Standard deviations of the guess: of the logarithm of the focal length, and of the distortion.
pub(crate) const PRIOR: [f64; 2] = [0.2, 0.1];
/// Added to every diagonal entry, so that directions nothing constrains (the unit of length) stay put.
const FLOOR: f64 = 1e-8;
/// A landmark nearer to the camera's plane than this is not fitted.
const LEAST_DEPTH: f64 = 1e-3;

/// Stretches of the walk whose pulls on the lens are compared. Key frames next to each other err alike: by what the model lacks (rows
/// exposed one after the other, late stamps), and by the same look at the same landmarks.
const STRETCHES: usize = 10;

/// What is solved for.
#[derive(Clone)]
pub(crate) struct State {
    pub lens: Lens,
    pub bias: Vec3,
    pub poses: Vec<Se3>,
    pub points: Vec<Vec3>,
}

/// An observation, linearised: the residual, and its derivatives.
struct Seen {
    residual: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    by_point: SMatrix<f64, 2, 3>,
    by_lens: Matrix2<f64>,
}

/// One landmark's part of the normal equations.
#[derive(Clone, Default)]
struct Point {
    block: Mat3,
    gradient: Vec3,
    by_lens: SMatrix<f64, 2, 3>,
    /// Of each observation: the unknowns of its pose, where that is free, and their block.
    by_pose: Vec<(usize, SMatrix<f64, 6, 3>)>,
}

/// The equations without the landmarks.
struct Reduced {
    factor: Cholesky<f64, Dyn>,
    right: DVector<f64>,
    /// Inverse of each landmark's block.
    inverses: Vec<Mat3>,
}

/// What is known of the lens with everything else marginalised.
pub(crate) struct LensLeft {
    /// How far it would still move.
    pub step: Vector2<f64>,
    /// The inverse of the information on it, for residuals of variance one.
    pub covariance: Matrix2<f64>,
    /// Its covariance by how far the stretches of the walk pull it apart.
    pub disagreement: Matrix2<f64>,
}

/// The problem with its current state. Unknowns: the free poses, the bias, the lens.
pub(crate) struct Joint<'a> {
    problem: &'a LensProblem,
    pub state: State,
    trial: State,
    /// The normal equations without the landmarks (the lower triangle), and those of each landmark.
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
    points: Vec<Point>,
}

impl<'a> Joint<'a> {
    pub fn new(problem: &'a LensProblem) -> Self {
        let (poses, points) = (problem.bundle.poses.clone(), problem.bundle.points.clone());
        let state = State { lens: Lens::GUESS, bias: Vec3::zeros(), poses, points };
        let unknowns = 6 * state.poses.len().saturating_sub(1) + 5;
        Self {
            problem,
            trial: state.clone(),
            hessian: DMatrix::zeros(unknowns, unknowns),
            gradient: DVector::zeros(unknowns),
            points: vec![Point::default(); state.points.len()],
            state,
        }
    }

    /// The first unknown of a pose; the first pose is fixed.
    fn of_pose(pose: usize) -> Option<usize> {
        Some(6 * pose.checked_sub(1)?)
    }

    fn of_bias(&self) -> usize {
        self.gradient.len() - 5
    }

    fn of_lens(&self) -> usize {
        self.gradient.len() - 2
    }

    /// At the current state, linearised: how far the lens would still move, and what is known of it. `None` where the equations are
    /// singular.
    pub fn lens_left(&mut self) -> Option<LensLeft> {
        to_end(self.linearise())?;
        let Reduced { factor, right, inverses } = self.reduced(0.0)?;
        let (at, n) = (self.of_lens(), self.gradient.len());
        let step = factor.solve(&right);
        let mut by_all = MatrixXx2::zeros(n);
        for k in 0..2 {
            by_all[(at + k, k)] = 1.0;
        }
        factor.solve_mut(&mut by_all);
        Some(LensLeft {
            step: step.fixed_rows::<2>(at).into_owned(),
            covariance: by_all.fixed_rows::<2>(at).into_owned(),
            disagreement: self.disagreement(&by_all, &inverses)?,
        })
    }

    /// The covariance of the lens by how far the stretches of the walk pull it apart (White, "Maximum likelihood estimation of
    /// misspecified models", 1982; the pulls are summed by stretch as in Liang & Zeger, 1986). `by_all` are the columns of the
    /// inverse for the lens, without the landmarks.
    fn disagreement(&self, by_all: &MatrixXx2<f64>, inverses: &[Mat3]) -> Option<Matrix2<f64>> {
        let at = self.of_lens();
        let of_lens = by_all.fixed_rows::<2>(at).into_owned();
        let by_points: Vec<SMatrix<f64, 3, 2>> = (self.points.iter().zip(inverses))
            .map(|(p, inverse)| {
                let mut sum = p.by_lens.tr_mul(&of_lens);
                for (a, w) in &p.by_pose {
                    sum += w.tr_mul(&by_all.fixed_view::<6, 2>(*a, 0));
                }
                -inverse * sum
            })
            .collect();
        let poses = self.state.poses.len();
        let stretch = |pose: usize| pose * STRETCHES / poses.max(1);
        let mut pulls = [Vector2::zeros(); STRETCHES];
        each_observation(self.problem, &self.state, |i, j, seen, w| {
            let mut by_lens = seen.by_lens * of_lens + seen.by_point * by_points[j];
            if let Some(a) = Self::of_pose(i) {
                by_lens += seen.by_pose * by_all.fixed_view::<6, 2>(a, 0);
            }
            pulls[stretch(i)] += by_lens.tr_mul(&seen.residual) * w;
        })?;
        let times = STRETCHES as f64 / (STRETCHES - 1) as f64;
        Some(pulls.iter().map(|pull| pull * pull.transpose() * times).sum())
    }

    /// Half the robust sum of squares of the observations.
    pub fn observation_cost(&self, state: &State) -> f64 {
        let views: Vec<Se3> = state.poses.iter().map(Se3::inverse).collect();
        let of = |o: &Observation| {
            let q = views[o.pose as usize] * state.points[o.point as usize];
            match (q.z > LEAST_DEPTH).then(|| self.problem.residual(&state.lens, o, &q)) {
                Some(r) => 0.5 * huber(r.norm_squared() * o.weight, Bundle::bound(o)).0,
                None => f64::INFINITY,
            }
        };
        self.problem.bundle.observations.iter().map(of).sum()
    }

    fn cost(&self, state: &State) -> f64 {
        let links = self.problem.links.iter();
        let gyro: f64 =
            links.map(|l| residual(l, &state.poses, &state.bias).norm_squared() / l.sigma.powi(2)).sum();
        let prior = (state.lens.focal.ln() / PRIOR[0]).powi(2)
            + (state.lens.radial / PRIOR[1]).powi(2)
            + state.bias.norm_squared() / BIAS_SIGMA.powi(2);
        self.observation_cost(state) + 0.5 * (gyro + prior)
    }

    fn clear(&mut self) {
        self.hessian.fill(0.0);
        self.gradient.fill(0.0);
        for p in &mut self.points {
            (p.block, p.gradient, p.by_lens) = (Mat3::zeros(), Vec3::zeros(), SMatrix::zeros());
            p.by_pose.clear();
        }
    }

    fn add_priors(&mut self) {
        let (bias, lens) = (self.of_bias(), self.of_lens());
        let values = [self.state.lens.focal.ln(), self.state.lens.radial];
        for k in 0..2 {
            self.hessian[(lens + k, lens + k)] += PRIOR[k].powi(-2);
            self.gradient[lens + k] += values[k] * PRIOR[k].powi(-2);
        }
        for k in 0..3 {
            self.hessian[(bias + k, bias + k)] += BIAS_SIGMA.powi(-2);
            self.gradient[bias + k] += self.state.bias[k] * BIAS_SIGMA.powi(-2);
        }
    }

    /// The rotations by the gyroscope.
    fn add_links(&mut self) {
        let poses = &self.state.poses;
        for l in &self.problem.links {
            let r = residual(l, poses, &self.state.bias);
            let inverse = So3::right_jacobian_inverse(&r);
            let back = (poses[l.to].rotation.inverse() * poses[l.from].rotation).matrix();
            let tilt = Self::of_pose(l.from).map(|at| (at + 3, -(inverse * back)));
            let to = Self::of_pose(l.to).map(|at| (at + 3, inverse));
            // The bias turns from the left, whose Jacobian is the transposed one of the right.
            let turned = So3::right_jacobian(&(self.state.bias * -l.seconds));
            let bias = Some((self.gradient.len() - 5, inverse.transpose() * turned * l.seconds));
            let parts: Vec<(usize, Mat3)> = [tilt, to, bias].into_iter().flatten().collect();
            let w = l.sigma.powi(-2);
            for (a, ja) in &parts {
                let mut g = self.gradient.fixed_rows_mut::<3>(*a);
                g += ja.tr_mul(&r) * w;
                for (b, jb) in parts.iter().filter(|(b, _)| b <= a) {
                    let mut block = self.hessian.fixed_view_mut::<3, 3>(*a, *b);
                    block += ja.tr_mul(jb) * w;
                }
            }
        }
    }

    /// The observations; `None` where a landmark is behind a camera.
    fn add_observations(&mut self) -> Option<()> {
        let lens_at = self.of_lens();
        each_observation(self.problem, &self.state, |i, j, seen, w| {
            let point = &mut self.points[j];
            point.block += seen.by_point.tr_mul(&seen.by_point) * w;
            point.gradient += seen.by_point.tr_mul(&seen.residual) * w;
            point.by_lens += seen.by_lens.tr_mul(&seen.by_point) * w;
            let mut own = self.hessian.fixed_view_mut::<2, 2>(lens_at, lens_at);
            own += seen.by_lens.tr_mul(&seen.by_lens) * w;
            let mut g = self.gradient.fixed_rows_mut::<2>(lens_at);
            g += seen.by_lens.tr_mul(&seen.residual) * w;
            if let Some(at) = Self::of_pose(i) {
                let mut own = self.hessian.fixed_view_mut::<6, 6>(at, at);
                own += seen.by_pose.tr_mul(&seen.by_pose) * w;
                let mut shared = self.hessian.fixed_view_mut::<2, 6>(lens_at, at);
                shared += seen.by_lens.tr_mul(&seen.by_pose) * w;
                let mut g = self.gradient.fixed_rows_mut::<6>(at);
                g += seen.by_pose.tr_mul(&seen.residual) * w;
                point.by_pose.push((at, seen.by_pose.tr_mul(&seen.by_point) * w));
            }
        })
    }

    /// Eliminates the landmarks and factors what is left; `None` where it is singular.
    fn reduced(&self, damping: f64) -> Option<Reduced> {
        let (mut h, mut right) = (self.hessian.clone(), -&self.gradient);
        let raised = |v: f64| v + damping * v + FLOOR;
        for k in 0..h.nrows() {
            h[(k, k)] = raised(h[(k, k)]);
        }
        let lens = self.of_lens();
        let mut inverses = Vec::with_capacity(self.points.len());
        for p in &self.points {
            let mut block = p.block;
            (0..3).for_each(|k| block[(k, k)] = raised(block[(k, k)]));
            let inverse = block.try_inverse().unwrap_or_else(Mat3::zeros);
            inverses.push(inverse);
            let by_lens = p.by_lens * inverse;
            let mut own = h.fixed_view_mut::<2, 2>(lens, lens);
            own -= by_lens * p.by_lens.transpose();
            let mut r = right.fixed_rows_mut::<2>(lens);
            r += by_lens * p.gradient;
            for (a, wa) in &p.by_pose {
                let wv = wa * inverse;
                let mut r = right.fixed_rows_mut::<6>(*a);
                r += wv * p.gradient;
                let mut shared = h.fixed_view_mut::<2, 6>(lens, *a);
                shared -= by_lens * wa.transpose();
                for (b, wb) in p.by_pose.iter().filter(|(b, _)| b <= a) {
                    let mut block = h.fixed_view_mut::<6, 6>(*a, *b);
                    block -= wv * wb.transpose();
                }
            }
        }
        Some(Reduced { factor: Cholesky::new(h)?, right, inverses })
    }
}

impl Problem for Joint<'_> {
    async fn linearise(&mut self) -> Option<f64> {
        self.clear();
        self.add_priors();
        self.add_links();
        self.add_observations()?;
        pause().await;
        Some(self.cost(&self.state))
    }

    async fn attempt(&mut self, damping: f64) -> Option<Trial> {
        let Reduced { factor, right, inverses } = self.reduced(damping)?;
        pause().await;
        let step = factor.solve(&right);
        let (bias, at) = (self.of_bias(), self.of_lens());
        let lens = step.fixed_rows::<2>(at).into_owned();
        let points = self.state.points.iter().zip(&self.points).zip(&inverses).map(|((x, p), inverse)| {
            let mut rest = -p.gradient - p.by_lens.tr_mul(&lens);
            for (a, w) in &p.by_pose {
                rest -= w.tr_mul(&step.fixed_rows::<6>(*a));
            }
            x + inverse * rest
        });
        let pose = |(i, p): (usize, &Se3)| match Self::of_pose(i) {
            Some(a) => p.retract(&SVector::<f64, 6>::from_column_slice(&step.as_slice()[a..a + 6])),
            None => *p,
        };
        let before = self.state.lens;
        self.trial = State {
            lens: Lens { focal: before.focal * lens[0].exp(), radial: before.radial + lens[1] },
            bias: self.state.bias + step.fixed_rows::<3>(bias),
            points: points.collect(),
            poses: self.state.poses.iter().enumerate().map(pose).collect(),
        };
        pause().await;
        Some(Trial { cost: self.cost(&self.trial), predicted_decrease: f64::NAN })
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.state, &mut self.trial);
    }
}

/// Gives pose, landmark, linearised residual and weight of each observation; `None` where a landmark is behind a camera.
fn each_observation(
    problem: &LensProblem,
    state: &State,
    mut give: impl FnMut(usize, usize, Seen, f64),
) -> Option<()> {
    let rotations: Vec<Mat3> = state.poses.iter().map(|p| p.rotation.inverse().matrix()).collect();
    let views: Vec<Se3> = state.poses.iter().map(Se3::inverse).collect();
    for o in &problem.bundle.observations {
        let (i, j) = (o.pose as usize, o.point as usize);
        let q = views[i] * state.points[j];
        if q.z <= LEAST_DEPTH {
            return None;
        }
        let seen = problem.linearised(&state.lens, o, &q, &rotations[i]);
        let (_, slope) = huber(seen.residual.norm_squared() * o.weight, Bundle::bound(o));
        give(i, j, seen, o.weight * slope);
    }
    Some(())
}

impl LensProblem {
    /// The residual of an observation of a landmark at `q` in the camera, pixels as measured.
    fn residual(&self, lens: &Lens, o: &Observation, q: &Vec3) -> Vector2<f64> {
        let camera = &self.bundle.camera;
        let d = Vec2::new(o.pixel[0] - camera.cx, o.pixel[1] - camera.cy);
        lens.stretched(camera, &d) - Vec2::new(camera.fx * q.x / q.z, camera.fy * q.y / q.z) * lens.focal
    }

    /// The same with its derivatives; `camera_from_world` is the rotation.
    fn linearised(&self, lens: &Lens, o: &Observation, q: &Vec3, camera_from_world: &Mat3) -> Seen {
        let camera = &self.bundle.camera;
        let d = Vec2::new(o.pixel[0] - camera.cx, o.pixel[1] - camera.cy);
        let seen = Vec2::new(camera.fx * q.x / q.z, camera.fy * q.y / q.z) * lens.focal;
        let rho = lens.rho_squared(camera, &d);
        let (fx, fy) = (lens.focal * camera.fx / q.z, lens.focal * camera.fy / q.z);
        let by_q = SMatrix::<f64, 2, 3>::new(fx, 0.0, -fx * q.x / q.z, 0.0, fy, -fy * q.y / q.z);
        let mut by_pose = SMatrix::<f64, 2, 6>::zeros();
        by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&by_q);
        by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&(-by_q * q.cross_matrix()));
        Seen {
            residual: lens.stretched(camera, &d) - seen,
            by_pose,
            by_point: -by_q * camera_from_world,
            by_lens: Matrix2::from_columns(&[d * (-2.0 * lens.radial * rho) - seen, d * rho]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::tests::{camera, problem};

    /// The derivative of the cost by every unknown beside the landmarks, and by some of these, against differences.
    #[test]
    fn gradient_is_the_derivative_of_the_cost() {
        let p = problem(&camera(500.0, 0.03), 1.0, true, 5);
        let mut joint = Joint::new(&p);
        joint.state.lens = Lens { focal: 1.05, radial: 0.01 };
        joint.state.bias = Vec3::new(0.01, -0.02, 0.005);
        to_end(joint.linearise()).unwrap();
        let n = joint.gradient.len();
        let moved = |k: usize, h: f64| {
            let mut s = joint.state.clone();
            match k {
                k if k + 5 < n => {
                    let mut delta = SVector::<f64, 6>::zeros();
                    delta[k % 6] = h;
                    s.poses[k / 6 + 1] = s.poses[k / 6 + 1].retract(&delta);
                }
                k if k + 2 < n => s.bias[k + 5 - n] += h,
                k if k + 2 == n => s.lens.focal *= h.exp(),
                _ => s.lens.radial += h,
            }
            joint.cost(&s)
        };
        let difference = |up: f64, down: f64| (up - down) / 2e-6;
        for k in 0..n {
            let d = difference(moved(k, 1e-6), moved(k, -1e-6));
            let g = joint.gradient[k];
            assert!((d - g).abs() < 1e-2 * g.abs() + 1.0, "{k} of {n}: {d} {g}");
        }
        for (k, point) in joint.points.iter().enumerate().step_by(50) {
            let at = |h: f64| {
                let mut s = joint.state.clone();
                s.points[k].y += h;
                joint.cost(&s)
            };
            let (d, g) = (difference(at(1e-6), at(-1e-6)), point.gradient.y);
            assert!((d - g).abs() < 1e-2 * g.abs() + 1.0, "point {k}: {d} {g}");
        }
    }
}
