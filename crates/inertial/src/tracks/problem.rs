//! The unknowns of a motion by tracks, its cost, and the descent to the least of it.

use super::found::TrackMotion;
use super::input::{TrackPoint, TrackPriors, Tracks};
use crate::{Bias, Gravity, NavState, Preintegrated};
use cairn_geometry::{Manifold, Mat3, Se3, So3, Vec3};
use cairn_solve::pause;
use nalgebra::{Matrix2x3, SMatrix, SVector, Vector2};

/// Unknowns: velocity (3), gravity's tilt (2), accelerometer's bias (3), gyroscope's (3), offset, log focal, readout.
pub const UNKNOWNS: usize = 14;
/// Where the biases, the offset, the focal length and the readout stand among them.
const ACCEL: usize = 5;
const GYRO: usize = 8;
const OFFSET: usize = 11;
const FOCAL: usize = 12;
const READOUT: usize = 13;
/// Frames and tracks below which nothing is told.
const LEAST_FRAMES: usize = 4;
const LEAST_TRACKS: usize = 20;
/// Steps of the descent, and the decrease of the cost, relative, below which it ends.
const STEPS: usize = 20;
const CONVERGED: f64 = 1e-5;
/// Standard deviation of a point's inverse depth before anything is known, 1/m: things are half a metre away or more.
const INVERSE_DEPTH_SIGMA: f64 = 2.0;
/// A ray counts as agreeing within so many standard deviations.
const AGREES: f64 = 3.0;
/// A point's depth is told where its inverse depth is known to this share.
const TOLD: f64 = 0.3;
/// Tracks that are linearised in one slice: half a millisecond where each is seen twenty times.
const TRACKS_IN_SLICE: usize = 32;
/// Steps of the numeric derivatives: m/s, radians, m/s^2, rad/s, seconds, logarithm, seconds.
const STEP: [f64; UNKNOWNS] =
    [1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5, 1e-5];

pub type Step = SVector<f64, UNKNOWNS>;
pub type Normal = SMatrix<f64, UNKNOWNS, UNKNOWNS>;

/// A state of the search, in the axes of the IMU at the first frame.
#[derive(Clone, Debug)]
pub struct State {
    pub velocity: Vec3,
    pub gravity: Gravity,
    pub bias: Bias,
    pub offset_s: f64,
    pub log_focal: f64,
    pub readout_s: f64,
    /// Of each track along the ray of its first point, 1/m.
    pub inverse_depths: Vec<f64>,
}

impl State {
    fn moved(&self, d: &Step) -> Self {
        let part = |i: usize| -> Vec3 { d.fixed_rows::<3>(i).into() };
        Self {
            velocity: self.velocity + part(0),
            gravity: self.gravity.retract(&Vector2::new(d[3], d[4])),
            bias: Bias { accel: self.bias.accel + part(ACCEL), gyro: self.bias.gyro + part(GYRO) },
            offset_s: self.offset_s + d[OFFSET],
            log_focal: self.log_focal + d[FOCAL],
            readout_s: self.readout_s + d[READOUT],
            inverse_depths: self.inverse_depths.clone(),
        }
    }

    /// The unknowns with a mean before, less that.
    fn off(&self) -> Step {
        let mut off = Step::zeros();
        off.fixed_rows_mut::<3>(ACCEL).copy_from(&self.bias.accel);
        off.fixed_rows_mut::<3>(GYRO).copy_from(&self.bias.gyro);
        (off[OFFSET], off[FOCAL], off[READOUT]) = (self.offset_s, self.log_focal, self.readout_s);
        off
    }
}

/// The measurements.
pub struct Problem<'a> {
    pub of: &'a Tracks<'a>,
    /// The readings from the first frame to each.
    pub sums: Vec<Preintegrated>,
    /// The gyroscope's reading at each frame.
    rates: Vec<Vec3>,
    /// Standard deviation of a position, metres, for each power 3/2 of a second that the readings are summed.
    walk: f64,
}

/// The cameras of a state, and how it reads rays.
struct Views {
    /// The axes and the place of each.
    cameras: Vec<(Mat3, Vec3)>,
    by_focal: f64,
    readout_s: f64,
}

/// A point of a track as it is seen.
struct Sight {
    /// The point along the first ray at a depth of 1, in the camera that sees it, and what a unit of inverse depth adds.
    q: Vec3,
    by_depth: Vec3,
    /// Less where it was seen.
    off: Vector2<f64>,
}

impl Views {
    /// The ray of a point with the focal length and the readout of the state.
    fn ray(&self, p: &TrackPoint) -> Vec3 {
        let at = |i: usize| (p.ray[i] + p.by_readout[i] * self.readout_s) * self.by_focal;
        Vec3::new(at(0), at(1), 1.0)
    }

    /// The direction of the first ray of a track.
    fn ahead(&self, first: &TrackPoint) -> Vec3 {
        self.cameras[first.frame].0 * self.ray(first)
    }

    /// A point of a track whose first ray has this direction and frame; `None` behind the camera.
    #[inline(always)]
    fn sight(&self, ahead: &Vec3, first: usize, p: &TrackPoint, inverse_depth: f64) -> Option<Sight> {
        let (axes, at) = &self.cameras[p.frame];
        let by_depth = axes.tr_mul(&(self.cameras[first].1 - at));
        let q = axes.tr_mul(ahead) + by_depth * inverse_depth;
        if q.z < 0.1 {
            return None;
        }
        let seen = self.ray(p);
        let off = Vector2::new(q.x / q.z - seen.x, q.y / q.z - seen.y);
        Some(Sight { q, by_depth, off })
    }
}

impl Sight {
    /// The derivative of the residual by the inverse depth.
    fn by_depth(&self) -> Vector2<f64> {
        let q = &self.q;
        Matrix2x3::new(1.0, 0.0, -q.x / q.z, 0.0, 1.0, -q.y / q.z) / q.z * self.by_depth
    }
}

impl<'a> Problem<'a> {
    pub fn new(of: &'a Tracks<'a>) -> Option<Self> {
        let first = of.links.first()?;
        let mut sums = vec![Preintegrated::new(*first.noise(), Bias::default())];
        for link in of.links {
            let mut next = sums[sums.len() - 1].clone();
            next.append(link);
            sums.push(next);
        }
        let enough = sums.len() >= LEAST_FRAMES && of.tracks.len() >= LEAST_TRACKS;
        let is_inside = |p: &TrackPoint| p.frame < sums.len();
        if !enough || !of.tracks.iter().all(|t| t.len() > 1 && t.iter().all(is_inside)) {
            return None;
        }
        let of_link = |end: bool| {
            move |l: &Preintegrated| {
                if end { l.samples().last() } else { l.samples().first() }.map(|s| s.gyro)
            }
        };
        let last = of.links.last().and_then(of_link(true));
        let rates =
            of.links.iter().map(of_link(false)).chain([last]).map(Option::unwrap_or_default).collect();
        Some(Self { of, sums, rates, walk: first.noise().accel / 3f64.sqrt() })
    }

    fn priors(&self) -> Step {
        let TrackPriors { bias: [gyro, accel], offset_s, log_focal, readout_s, .. } = self.of.priors;
        let mut sigma = Step::repeat(f64::INFINITY);
        (0..3).for_each(|i| (sigma[ACCEL + i], sigma[GYRO + i]) = (accel, gyro));
        (sigma[OFFSET], sigma[FOCAL], sigma[READOUT]) =
            (offset_s.max(1e-6), log_focal.max(1e-6), readout_s.max(1e-7));
        sigma
    }

    /// The IMU's state at a frame, by the readings: they are of that time, and the frame was taken the offset earlier.
    fn nav(&self, s: &State, k: usize) -> NavState {
        let from = NavState { velocity: s.velocity, bias: s.bias, ..NavState::identity() };
        let at = self.sums[k].predict(&from, &s.gravity.vector());
        let turned = So3::exp(&((self.rates[k] - s.bias.gyro) * -s.offset_s));
        let Se3 { rotation, translation } = at.world_from_imu;
        let pose = Se3::new(rotation * turned, translation - at.velocity * s.offset_s);
        NavState { world_from_imu: pose, ..at }
    }

    fn views(&self, s: &State) -> Views {
        let camera = |k| {
            let Se3 { rotation, translation } = self.nav(s, k).world_from_imu * self.of.imu_from_camera;
            (rotation.matrix(), translation)
        };
        let cameras = (0..self.sums.len()).map(camera).collect();
        Views { cameras, by_focal: (-s.log_focal).exp(), readout_s: s.readout_s }
    }

    /// The variance of a ray, of which the readings' noise is a part.
    fn variance(&self, first: &TrackPoint, p: &TrackPoint, inverse_depth: f64) -> f64 {
        let apart = (self.sums[p.frame].seconds() - self.sums[first.frame].seconds()).abs();
        let carried = inverse_depth * self.walk * apart * apart.sqrt();
        2.0 * self.of.priors.ray.powi(2) + carried * carried
    }

    /// The cost of a state, and how many points agree of how many, with the sum of their squares.
    fn cost(&self, s: &State) -> (f64, [f64; 3]) {
        let (views, sigma, off) = (self.views(s), self.priors(), s.off());
        let mut cost = (0..UNKNOWNS).map(|i| 0.5 * (off[i] / sigma[i]).powi(2)).sum::<f64>();
        let mut told = [0.0; 3];
        for (track, rho) in self.of.tracks.iter().zip(&s.inverse_depths) {
            cost += 0.5 * (rho / INVERSE_DEPTH_SIGMA).powi(2);
            let ahead = views.ahead(&track[0]);
            for p in &track[1..] {
                let variance = self.variance(&track[0], p, *rho);
                let sight = views.sight(&ahead, track[0].frame, p, *rho);
                let square = sight.map_or(1e4, |sight| sight.off.norm_squared() / variance);
                // Of Cauchy, with the bound at which rays agree.
                let bound = AGREES * AGREES;
                cost += 0.5 * bound * (1.0 + square / bound).ln() + 0.5 * variance.ln();
                told[1] += 1.0;
                if square < bound {
                    (told[0], told[2]) = (told[0] + 1.0, told[2] + square);
                }
            }
        }
        (cost, told)
    }

    /// Normal equations with the inverse depths eliminated; with what is needed to find these again.
    async fn linearise(&self, s: &State) -> (Normal, Step, Vec<(Step, f64, f64)>) {
        let (sigma, off) = (self.priors(), s.off());
        let mut h = Normal::zeros();
        let mut g = Step::zeros();
        for i in 0..UNKNOWNS {
            h[(i, i)] = sigma[i].powi(-2);
            g[i] = off[i] * sigma[i].powi(-2);
        }
        let views = self.views(s);
        let moved: [Views; UNKNOWNS] = std::array::from_fn(|i| {
            let mut d = Step::zeros();
            d[i] = STEP[i];
            self.views(&State { inverse_depths: Vec::new(), ..s.moved(&d) })
        });
        let mut eliminated = Vec::with_capacity(self.of.tracks.len());
        for (nth, (track, rho)) in self.of.tracks.iter().zip(&s.inverse_depths).enumerate() {
            if nth.is_multiple_of(TRACKS_IN_SLICE) {
                pause().await;
            }
            let (mut coupled, mut own) = (Step::zeros(), INVERSE_DEPTH_SIGMA.powi(-2));
            let mut right = rho * own;
            let first = &track[0];
            let (ahead, moved_ahead) = (views.ahead(first), moved.each_ref().map(|views| views.ahead(first)));
            for p in &track[1..] {
                let Some(sight) = views.sight(&ahead, first.frame, p, *rho) else { continue };
                let (r, by_rho) = (sight.off, sight.by_depth());
                let variance = self.variance(first, p, *rho);
                let weight = 1.0 / (1.0 + r.norm_squared() / (variance * AGREES * AGREES)) / variance;
                let mut j = SMatrix::<f64, 2, UNKNOWNS>::zeros();
                for (i, (views, ahead)) in moved.iter().zip(&moved_ahead).enumerate() {
                    if let Some(sight) = views.sight(ahead, first.frame, p, *rho) {
                        j.set_column(i, &((sight.off - r) / STEP[i]));
                    }
                }
                h += j.transpose() * j * weight;
                g += j.transpose() * r * weight;
                coupled += j.transpose() * by_rho * weight;
                own += by_rho.norm_squared() * weight;
                right += by_rho.dot(&r) * weight;
            }
            h -= coupled * coupled.transpose() / own;
            g -= coupled * (right / own);
            eliminated.push((coupled, own, right));
        }
        (h, g, eliminated)
    }

    /// Levenberg-Marquardt from a first guess.
    pub async fn solve(mut self, mut s: State) -> Option<TrackMotion> {
        let mut damping = 1e-4;
        let (mut cost, _) = self.cost(&s);
        for _ in 0..STEPS {
            self.follow(&s.bias);
            let (h, g, eliminated) = self.linearise(&s).await;
            pause().await;
            let mut damped = h;
            (0..UNKNOWNS).for_each(|i| damped[(i, i)] *= 1.0 + damping);
            let step: Step = -damped.cholesky()?.solve(&g);
            let mut next = s.moved(&step);
            for (rho, (coupled, own, right)) in next.inverse_depths.iter_mut().zip(&eliminated) {
                *rho = (*rho - (right + coupled.dot(&step)) / own).max(0.0);
            }
            let (lower, _) = self.cost(&next);
            if lower < cost {
                let is_flat = cost - lower < CONVERGED * cost.abs().max(1.0);
                (s, cost, damping) = (next, lower, (damping * 0.1).max(1e-9));
                if is_flat {
                    break;
                }
            } else {
                damping *= 10.0;
                if damping > 1e6 {
                    break;
                }
            }
        }
        self.motion(&s).await
    }

    /// The sums again at a bias that is far from theirs.
    fn follow(&mut self, bias: &Bias) {
        self.sums.iter_mut().for_each(|sum| sum.follow(bias));
    }

    async fn motion(&self, s: &State) -> Option<TrackMotion> {
        let (_, [agree, all, squares]) = self.cost(s);
        let (h, _, eliminated) = self.linearise(s).await;
        let factor =
            (squares / (2.0 * agree - UNKNOWNS as f64 - s.inverse_depths.len() as f64).max(1.0)).max(1.0);
        let covariance = h.cholesky()?.inverse() * factor;
        let sigma = |i: usize| covariance[(i, i)].sqrt();
        let level = s.gravity.world_from_level.inverse();
        let states: Vec<NavState> = (0..self.sums.len())
            .map(|k| {
                let at = self.nav(s, k);
                let pose = Se3::new(level, Vec3::zeros()) * at.world_from_imu;
                NavState { world_from_imu: pose, velocity: level * at.velocity, bias: s.bias }
            })
            .collect();
        let views = self.views(s);
        let points = self.of.tracks.iter().zip(&s.inverse_depths).zip(&eliminated);
        let points = points.map(|((track, rho), (_, own, _))| {
            let is_told = *rho > 0.0 && (factor / own).sqrt() < TOLD * rho;
            let ahead = views.ahead(&track[0]);
            let agrees = track[1..].iter().all(|p| {
                let bound = factor * AGREES * AGREES * self.variance(&track[0], p, *rho);
                let sight = views.sight(&ahead, track[0].frame, p, *rho);
                sight.is_some_and(|sight| sight.off.norm_squared() < bound)
            });
            let at = views.cameras[track[0].frame].1 + ahead / *rho;
            (is_told && agrees).then(|| level * at)
        });
        Some(TrackMotion {
            points: points.collect(),
            scale_sigma: self.scale_sigma(s, &covariance),
            gravity_sigma: covariance
                .fixed_view::<2, 2>(3, 3)
                .into_owned()
                .symmetric_eigenvalues()
                .max()
                .sqrt(),
            residual: (squares / (2.0 * agree).max(1.0)).sqrt(),
            agreeing: agree / all.max(1.0),
            offset_s: [s.offset_s, sigma(OFFSET)],
            log_focal: [s.log_focal, sigma(FOCAL)],
            readout_s: [s.readout_s, sigma(READOUT)],
            states,
        })
    }

    /// Standard deviation of the logarithm of how far the frames are spread.
    fn scale_sigma(&self, s: &State, covariance: &Normal) -> f64 {
        let spread = |s: &State| {
            let cameras = self.views(s).cameras;
            let mean = cameras.iter().map(|(_, at)| at).sum::<Vec3>() / cameras.len() as f64;
            0.5 * cameras.iter().map(|(_, at)| (at - mean).norm_squared()).sum::<f64>().max(1e-12).ln()
        };
        let here = spread(s);
        let by = Step::from_fn(|i, _| {
            let mut d = Step::zeros();
            d[i] = STEP[i];
            (spread(&s.moved(&d)) - here) / STEP[i]
        });
        (by.transpose() * covariance * by)[(0, 0)].max(0.0).sqrt()
    }
}
