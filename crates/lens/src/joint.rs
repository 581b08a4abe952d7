//! The lens, the readout of the rows, the gyroscope's bias and clock, all poses and all landmarks as one least-squares problem, for the one Levenberg-Marquardt
//! loop. The landmarks are eliminated (Triggs et al., "Bundle adjustment: a modern synthesis", 2000, section 6); what is left is
//! some hundred unknowns, of which each pair is coupled by the lens, and is solved densely.
//!
//! Residuals are in pixels as measured: with the lens `(s, c)` and a landmark at `X` in the camera,
//! `r = d (1 + c rho^2) - s f X_xy / X_z`, where `d` is the offset from the principal point as corrected with the readout.

use crate::gyro::{BIAS_SIGMA, Clock, LATE_SIGMA_S};
use crate::model::Lens;
use crate::problem::LensProblem;
use cairn_geometry::{Manifold, Mat3, Se3, Vec2, Vec3};
use cairn_solve::{Bundle, Observation, Problem, Trial, huber, pause, to_end};
use nalgebra::{
    Cholesky, DMatrix, DVector, Dyn, Matrix2x3, Matrix3x4, Matrix4, MatrixXx4, SMatrix, SVector, Vector2,
    Vector4,
};

/// Standard deviations of the guess: of the logarithm of the focal length, and of the distortion.
pub(crate) const PRIOR: [f64; 2] = [0.2, 0.1];
/// Standard deviation of the readout time that the images were corrected with, seconds.
const READOUT_SIGMA_S: f64 = 0.01;
/// Unknowns beside the poses: of the gyroscope (bias, clock), and of the camera (lens, readout).
const OF_GYRO: usize = 4;
const OF_CAMERA: usize = 3;
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
    pub optics: Optics,
    pub clock: Clock,
    pub poses: Vec<Se3>,
    pub points: Vec<Vec3>,
}

/// What is estimated of the camera: its lens, and the readout time beyond that which the images were corrected with, seconds.
#[derive(Clone, Copy)]
pub(crate) struct Optics {
    pub lens: Lens,
    pub readout_s: f64,
}

impl Optics {
    const GUESS: Self = Self { lens: Lens::GUESS, readout_s: 0.0 };

    fn values(&self) -> [f64; OF_CAMERA] {
        [self.lens.focal.ln(), self.lens.radial, self.readout_s]
    }

    const SIGMA: [f64; OF_CAMERA] = [PRIOR[0], PRIOR[1], READOUT_SIGMA_S];
}

/// An observation, linearised: the residual, and its derivatives.
struct Seen {
    residual: Vector2<f64>,
    by_pose: SMatrix<f64, 2, 6>,
    by_point: SMatrix<f64, 2, 3>,
    by_camera: Matrix2x3<f64>,
}

/// One landmark's part of the normal equations.
#[derive(Clone, Default)]
struct Point {
    block: Mat3,
    gradient: Vec3,
    by_camera: Mat3,
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

/// What is known of focal length, distortion, readout and offset of the clocks, with everything else marginalised.
pub(crate) struct Left {
    /// How far they would still move.
    pub step: Vector4<f64>,
    /// The inverse of the information on them, for residuals of variance one.
    pub covariance: Matrix4<f64>,
    /// Their covariance by how far the stretches of the walk pull them apart.
    pub disagreement: Matrix4<f64>,
}

/// The problem with its current state. Unknowns: the free poses, the bias and clock of the gyroscope, lens and readout.
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
        let state = State { optics: Optics::GUESS, clock: Clock::default(), poses, points };
        let unknowns = 6 * state.poses.len().saturating_sub(1) + OF_GYRO + OF_CAMERA;
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

    fn of_gyro(&self) -> usize {
        self.gradient.len() - OF_CAMERA - OF_GYRO
    }

    fn of_camera(&self) -> usize {
        self.gradient.len() - OF_CAMERA
    }

    /// At the current state, linearised: what is known. `None` where the equations are singular.
    pub fn left(&mut self) -> Option<Left> {
        to_end(self.linearise())?;
        let Reduced { factor, right, inverses } = self.reduced(0.0)?;
        let camera = self.of_camera();
        let of = [camera, camera + 1, camera + 2, self.of_gyro() + 3];
        let step = factor.solve(&right);
        let mut by_all = MatrixXx4::zeros(self.gradient.len());
        for (k, at) in of.into_iter().enumerate() {
            by_all[(at, k)] = 1.0;
        }
        factor.solve_mut(&mut by_all);
        Some(Left {
            step: Vector4::from(of.map(|at| step[at])),
            covariance: Matrix4::from_fn(|i, k| by_all[(of[i], k)]),
            disagreement: self.disagreement(&by_all, &inverses)?,
        })
    }

    /// The covariance by how far the stretches of the walk pull apart what is found (White, "Maximum likelihood estimation of
    /// misspecified models", 1982; the pulls are summed by stretch as in Liang & Zeger, 1986). `by_all` are the columns of
    /// the inverse for that, without the landmarks.
    fn disagreement(&self, by_all: &MatrixXx4<f64>, inverses: &[Mat3]) -> Option<Matrix4<f64>> {
        let of_camera = by_all.fixed_rows::<OF_CAMERA>(self.of_camera()).into_owned();
        let by_points: Vec<Matrix3x4<f64>> = (self.points.iter().zip(inverses))
            .map(|(p, inverse)| {
                let mut sum = p.by_camera.tr_mul(&of_camera);
                for (a, w) in &p.by_pose {
                    sum += w.tr_mul(&by_all.fixed_view::<6, 4>(*a, 0));
                }
                -inverse * sum
            })
            .collect();
        let poses = self.state.poses.len();
        let stretch = |pose: usize| pose * STRETCHES / poses.max(1);
        let mut pulls = [Vector4::zeros(); STRETCHES];
        each_observation(self.problem, &self.state, |i, j, seen, w| {
            let mut by_each = seen.by_camera * of_camera + seen.by_point * by_points[j];
            if let Some(a) = Self::of_pose(i) {
                by_each += seen.by_pose * by_all.fixed_view::<6, 4>(a, 0);
            }
            pulls[stretch(i)] += by_each.tr_mul(&seen.residual) * w;
        })?;
        let times = STRETCHES as f64 / (STRETCHES - 1) as f64;
        Some(pulls.iter().map(|pull| pull * pull.transpose() * times).sum())
    }

    /// Half the robust sum of squares of the observations.
    pub fn observation_cost(&self, state: &State) -> f64 {
        let views: Vec<Se3> = state.poses.iter().map(Se3::inverse).collect();
        let of = |(o, slope): (&Observation, &Vec2)| {
            let q = views[o.pose as usize] * state.points[o.point as usize];
            match (q.z > LEAST_DEPTH).then(|| self.problem.residual(&state.optics, (o, slope), &q)) {
                Some(r) => 0.5 * huber(r.norm_squared() * o.weight, Bundle::bound(o)).0,
                None => f64::INFINITY,
            }
        };
        self.problem.observations().map(of).sum()
    }

    fn cost(&self, state: &State) -> f64 {
        let links = self.problem.links.iter();
        let gyro: f64 =
            links.map(|l| state.clock.residual(l, &state.poses).norm_squared() / l.sigma.powi(2)).sum();
        let optics =
            state.optics.values().into_iter().zip(Optics::SIGMA).map(|(v, sigma)| (v / sigma).powi(2));
        let prior = optics.sum::<f64>()
            + (state.clock.late_s / LATE_SIGMA_S).powi(2)
            + state.clock.bias.norm_squared() / BIAS_SIGMA.powi(2);
        self.observation_cost(state) + 0.5 * (gyro + prior)
    }

    fn clear(&mut self) {
        self.hessian.fill(0.0);
        self.gradient.fill(0.0);
        for p in &mut self.points {
            (p.block, p.gradient, p.by_camera) = (Mat3::zeros(), Vec3::zeros(), Mat3::zeros());
            p.by_pose.clear();
        }
    }

    fn add_priors(&mut self) {
        let (gyro, camera) = (self.of_gyro(), self.of_camera());
        let Clock { bias, late_s } = self.state.clock;
        let of_gyro = bias.iter().map(|b| (*b, BIAS_SIGMA)).chain([(late_s, LATE_SIGMA_S)]);
        let of_camera = self.state.optics.values().into_iter().zip(Optics::SIGMA);
        for (k, (value, sigma)) in (gyro..).zip(of_gyro).chain((camera..).zip(of_camera)) {
            self.hessian[(k, k)] += sigma.powi(-2);
            self.gradient[k] += value * sigma.powi(-2);
        }
    }

    /// The rotations by the gyroscope.
    fn add_links(&mut self) {
        for l in &self.problem.links {
            let seen = self.state.clock.linearised(l, &self.state.poses);
            let starts = [Self::of_pose(l.from), Self::of_pose(l.to), Some(self.of_gyro())];
            let of = |at: usize, block: &Mat3| [0, 1, 2].map(|k| (at + k, block.column(k).into_owned()));
            let mut columns = vec![(self.of_gyro() + 3, seen.by_late)];
            let blocks = [&seen.by_from, &seen.by_to, &seen.by_bias];
            for (k, (at, block)) in starts.into_iter().zip(blocks).enumerate() {
                // Of a pose the rotation comes after the translation.
                let shift = if k < 2 { 3 } else { 0 };
                columns.extend(at.into_iter().flat_map(|at| of(at + shift, block)));
            }
            let w = l.sigma.powi(-2);
            for (a, ja) in &columns {
                self.gradient[*a] += ja.dot(&seen.residual) * w;
                for (b, jb) in columns.iter().filter(|(b, _)| b <= a) {
                    self.hessian[(*a, *b)] += ja.dot(jb) * w;
                }
            }
        }
    }

    /// The observations; `None` where a landmark is behind a camera.
    fn add_observations(&mut self) -> Option<()> {
        let camera = self.of_camera();
        each_observation(self.problem, &self.state, |i, j, seen, w| {
            let point = &mut self.points[j];
            point.block += seen.by_point.tr_mul(&seen.by_point) * w;
            point.gradient += seen.by_point.tr_mul(&seen.residual) * w;
            point.by_camera += seen.by_camera.tr_mul(&seen.by_point) * w;
            let mut own = self.hessian.fixed_view_mut::<OF_CAMERA, OF_CAMERA>(camera, camera);
            own += seen.by_camera.tr_mul(&seen.by_camera) * w;
            let mut g = self.gradient.fixed_rows_mut::<OF_CAMERA>(camera);
            g += seen.by_camera.tr_mul(&seen.residual) * w;
            if let Some(at) = Self::of_pose(i) {
                let mut own = self.hessian.fixed_view_mut::<6, 6>(at, at);
                own += seen.by_pose.tr_mul(&seen.by_pose) * w;
                let mut shared = self.hessian.fixed_view_mut::<OF_CAMERA, 6>(camera, at);
                shared += seen.by_camera.tr_mul(&seen.by_pose) * w;
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
        let camera = self.of_camera();
        let mut inverses = Vec::with_capacity(self.points.len());
        for p in &self.points {
            let mut block = p.block;
            (0..3).for_each(|k| block[(k, k)] = raised(block[(k, k)]));
            let inverse = block.try_inverse().unwrap_or_else(Mat3::zeros);
            inverses.push(inverse);
            let by_camera = p.by_camera * inverse;
            let mut own = h.fixed_view_mut::<OF_CAMERA, OF_CAMERA>(camera, camera);
            own -= by_camera * p.by_camera.transpose();
            let mut r = right.fixed_rows_mut::<OF_CAMERA>(camera);
            r += by_camera * p.gradient;
            for (a, wa) in &p.by_pose {
                let wv = wa * inverse;
                let mut r = right.fixed_rows_mut::<6>(*a);
                r += wv * p.gradient;
                let mut shared = h.fixed_view_mut::<OF_CAMERA, 6>(camera, *a);
                shared -= by_camera * wa.transpose();
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
        let gyro = step.fixed_rows::<OF_GYRO>(self.of_gyro()).into_owned();
        let camera = step.fixed_rows::<OF_CAMERA>(self.of_camera()).into_owned();
        let points = self.state.points.iter().zip(&self.points).zip(&inverses).map(|((x, p), inverse)| {
            let mut rest = -p.gradient - p.by_camera.tr_mul(&camera);
            for (a, w) in &p.by_pose {
                rest -= w.tr_mul(&step.fixed_rows::<6>(*a));
            }
            x + inverse * rest
        });
        let pose = |(i, p): (usize, &Se3)| match Self::of_pose(i) {
            Some(a) => p.retract(&SVector::<f64, 6>::from_column_slice(&step.as_slice()[a..a + 6])),
            None => *p,
        };
        let (of_gyro, of_camera) = (self.state.clock, self.state.optics);
        let before = of_camera.lens;
        self.trial = State {
            optics: Optics {
                lens: Lens { focal: before.focal * camera[0].exp(), radial: before.radial + camera[1] },
                readout_s: of_camera.readout_s + camera[2],
            },
            clock: Clock { bias: of_gyro.bias + gyro.xyz(), late_s: of_gyro.late_s + gyro[3] },
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
    for (o, slope) in problem.observations() {
        let (i, j) = (o.pose as usize, o.point as usize);
        let q = views[i] * state.points[j];
        if q.z <= LEAST_DEPTH {
            return None;
        }
        let seen = problem.linearised(&state.optics, (o, slope), &q, &rotations[i]);
        let (_, slope) = huber(seen.residual.norm_squared() * o.weight, Bundle::bound(o));
        give(i, j, seen, o.weight * slope);
    }
    Some(())
}

impl LensProblem {
    /// The observations, each with the pixels that a longer readout moves it by, a second.
    fn observations(&self) -> impl Iterator<Item = (&Observation, &Vec2)> {
        self.bundle.observations.iter().zip(&self.slopes)
    }

    /// Where an observation is seen from the principal point, with this readout.
    fn offset(&self, readout_s: f64, (o, slope): (&Observation, &Vec2)) -> Vec2 {
        Vec2::new(o.pixel[0] - self.bundle.camera.cx, o.pixel[1] - self.bundle.camera.cy) + slope * readout_s
    }

    /// The residual of an observation of a landmark at `q` in the camera, pixels as measured.
    fn residual(&self, of: &Optics, seen: (&Observation, &Vec2), q: &Vec3) -> Vector2<f64> {
        let (camera, lens) = (&self.bundle.camera, &of.lens);
        let d = self.offset(of.readout_s, seen);
        lens.stretched(camera, &d) - Vec2::new(camera.fx * q.x / q.z, camera.fy * q.y / q.z) * lens.focal
    }

    /// The same with its derivatives; `camera_from_world` is the rotation.
    fn linearised(
        &self,
        of: &Optics,
        observation: (&Observation, &Vec2),
        q: &Vec3,
        camera_from_world: &Mat3,
    ) -> Seen {
        let (camera, lens) = (&self.bundle.camera, &of.lens);
        let d = self.offset(of.readout_s, observation);
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
            by_camera: Matrix2x3::from_columns(&[
                d * (-2.0 * lens.radial * rho) - seen,
                d * rho,
                lens.by_offset(camera, &d) * observation.1,
            ]),
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
        joint.state.optics = Optics { lens: Lens { focal: 1.05, radial: 0.01 }, readout_s: 4e-3 };
        joint.state.clock = Clock { bias: Vec3::new(0.01, -0.02, 0.005), late_s: 8e-3 };
        to_end(joint.linearise()).unwrap();
        let n = joint.gradient.len();
        let moved = |k: usize, h: f64| {
            let mut s = joint.state.clone();
            match k {
                k if k + 7 < n => {
                    let mut delta = SVector::<f64, 6>::zeros();
                    delta[k % 6] = h;
                    s.poses[k / 6 + 1] = s.poses[k / 6 + 1].retract(&delta);
                }
                k if k + 4 < n => s.clock.bias[k + 7 - n] += h,
                k if k + 4 == n => s.clock.late_s += h,
                k if k + 3 == n => s.optics.lens.focal *= h.exp(),
                k if k + 2 == n => s.optics.lens.radial += h,
                _ => s.optics.readout_s += h,
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
