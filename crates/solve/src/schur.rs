//! Cameras and points: the points are eliminated, the cameras solved sparsely, the points found from them.
//!
//! Source: Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6. Blocks are stored by columns.

use crate::sparse::{Analysis, Factor};
use cairn_geometry::{Mat3, Vec3};
use nalgebra::{SMatrix, SVector};
use std::ops::Range;
use std::sync::Arc;

/// Which camera sees which point, analysed; cameras have `P` parameters.
pub struct Schur<const P: usize> {
    /// The observations of each point.
    ranges: Vec<Range<usize>>,
    /// Of each observation the place of its camera among the free ones.
    slots: Vec<Option<u32>>,
    factor: Factor,
    /// Index of the block of two cameras, where there are few enough for a table.
    table: Vec<u32>,
    /// The reduced system's diagonal and other blocks.
    diagonal: Vec<SMatrix<f64, P, P>>,
    off: Vec<SMatrix<f64, P, P>>,
}

/// The undamped normal equations at a state.
#[derive(Clone)]
pub struct Normal<const P: usize> {
    /// Of each free camera.
    pub cameras: Vec<SMatrix<f64, P, P>>,
    pub camera_gradients: Vec<SVector<f64, P>>,
    /// Of each point.
    pub points: Vec<Mat3>,
    pub point_gradients: Vec<Vec3>,
    /// Of each observation: camera by point.
    pub couplings: Vec<SMatrix<f64, P, 3>>,
    pub cost: f64,
}

/// A step of all free cameras and points, and what the linear model says that it gains.
pub struct Step<const P: usize> {
    pub cameras: Vec<SVector<f64, P>>,
    pub points: Vec<Vec3>,
    /// Of the border; zero without one and where it is held.
    pub border: f64,
    /// How far the border would move if it were not held.
    pub border_pull: f64,
    /// What is known of the border once all else is free: the inverse of its variance.
    pub border_information: f64,
    pub promise: f64,
}

/// One unknown more, which every camera and point may be tied to: its own entry, gradient, and couplings.
#[derive(Clone, Default)]
pub struct Border<const P: usize> {
    pub hessian: f64,
    pub gradient: f64,
    /// With each free camera.
    pub cameras: Vec<SVector<f64, P>>,
    /// With each point.
    pub points: Vec<Vec3>,
    /// True to tell only how far it would move; it and all else take the step without it.
    pub held: bool,
}

/// Most free cameras for which a table of pairs is kept.
const TABLE: usize = 2048;

impl<const P: usize> Normal<P> {
    /// Zeros for so many free cameras, points and observations.
    pub fn zeros(cameras: usize, points: usize, observations: usize) -> Self {
        Self {
            cameras: vec![SMatrix::zeros(); cameras],
            camera_gradients: vec![SVector::zeros(); cameras],
            points: vec![Mat3::zeros(); points],
            point_gradients: vec![Vec3::zeros(); points],
            couplings: vec![SMatrix::zeros(); observations],
            cost: 0.0,
        }
    }

    /// Zeros again.
    pub fn clear(&mut self) {
        self.cameras.fill(SMatrix::zeros());
        self.camera_gradients.fill(SVector::zeros());
        self.points.fill(Mat3::zeros());
        self.point_gradients.fill(Vec3::zeros());
        self.couplings.fill(SMatrix::zeros());
        self.cost = 0.0;
    }
}

impl<const P: usize> Schur<P> {
    /// Of `cameras` free cameras and observations grouped by point (those of a point stand together): the point of each,
    /// below `points`, and the place of its camera among the free ones.
    pub fn new(
        cameras: usize,
        points: usize,
        observations: impl Iterator<Item = (usize, Option<u32>)>,
    ) -> Self {
        let (mut ranges, mut slots) = (vec![0..0; points], Vec::new());
        for (k, (point, slot)) in observations.enumerate() {
            let start = if ranges[point].is_empty() { k } else { ranges[point].start };
            ranges[point] = start..k + 1;
            slots.push(slot);
        }
        // Each pair once: for each camera, the cameras of lower place that share a point with it.
        let mut shared: Vec<Vec<u32>> = vec![Vec::new(); cameras];
        for range in &ranges {
            let seen = &slots[range.clone()];
            for a in seen.iter().flatten() {
                shared[*a as usize].extend(seen.iter().flatten().filter(|b| *b < a));
            }
            for a in seen.iter().flatten() {
                let list = &mut shared[*a as usize];
                if list.len() > 4 * cameras + 64 {
                    list.sort_unstable();
                    list.dedup();
                }
            }
        }
        let pairs =
            shared.iter().enumerate().flat_map(|(a, list)| list.iter().map(move |b| (a, *b as usize)));
        let analysis = Arc::new(Analysis::new(cameras, P, pairs));
        let table = if cameras <= TABLE { table_of(&analysis) } else { Vec::new() };
        Self {
            ranges,
            slots,
            table,
            diagonal: vec![SMatrix::zeros(); cameras],
            off: vec![SMatrix::zeros(); analysis.pairs().len()],
            factor: Factor::new(analysis),
        }
    }

    /// The range of a point's observations.
    fn observations(&self, point: usize) -> Range<usize> {
        self.ranges[point].clone()
    }

    /// Index of the block of two cameras, the first of higher place.
    fn pair(&self, a: u32, b: u32) -> usize {
        let n = self.diagonal.len();
        if self.table.is_empty() {
            // Present by construction.
            return self.factor.analysis().pair(a as usize, b as usize).unwrap_or(0);
        }
        self.table[a as usize * n + b as usize] as usize
    }

    /// The step with every diagonal entry raised by `lambda` of itself and `floor`; `None` when it is singular.
    pub fn step(
        &mut self,
        normal: &Normal<P>,
        border: Option<&Border<P>>,
        lambda: f64,
        floor: f64,
    ) -> Option<Step<P>> {
        let damping = |h: f64| lambda * h + floor;
        self.off.fill(SMatrix::zeros());
        self.diagonal.copy_from_slice(&normal.cameras);
        for block in &mut self.diagonal {
            (0..P).for_each(|k| block[(k, k)] += damping(block[(k, k)]));
        }
        let mut cameras: Vec<SVector<f64, P>> = normal.camera_gradients.iter().map(|g| -g).collect();
        let inverses = self.reduce(normal, &damping, &mut cameras);
        let (diagonal, off) = (numbers(&self.diagonal), numbers(&self.off));
        self.factor.factor(&diagonal, &off).ok()?;
        self.solve(&mut cameras);
        let (border_pull, border_information) = match border {
            Some(border) => self.along(normal, border, &inverses, lambda, &mut cameras)?,
            None => (0.0, 0.0),
        };
        let border = border.filter(|border| !border.held);
        let along = border.map_or(0.0, |_| border_pull);
        let mut points: Vec<Vec3> = Vec::with_capacity(inverses.len());
        for (point, inverse) in inverses.iter().enumerate() {
            let mut rest = -normal.point_gradients[point];
            if let Some(border) = border {
                rest -= border.points[point] * along;
            }
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    rest -= normal.couplings[k].tr_mul(&cameras[slot as usize]);
                }
            }
            points.push(inverse * rest);
        }
        let promise = promise(normal, &damping, &cameras, &points);
        let promise =
            promise + border.map_or(0.0, |b| 0.5 * along * (lambda * b.hessian * along - b.gradient));
        promise.is_finite().then_some(Step {
            cameras,
            points,
            border: along,
            border_pull,
            border_information,
            promise,
        })
    }

    /// Solves the reduced system that was factored last.
    fn solve(&self, cameras: &mut [SVector<f64, P>]) {
        let mut x: Vec<f64> = cameras.iter().flat_map(|v| v.iter().copied()).collect();
        self.factor.solve(&mut x);
        cameras.iter_mut().zip(x.chunks_exact(P)).for_each(|(v, x)| v.copy_from_slice(x));
    }

    /// The step of the border with its information, and, where it is not held, what it changes in that of the cameras, which holds
    /// the step without it: block elimination of the last row of the reduced system.
    fn along(
        &self,
        normal: &Normal<P>,
        border: &Border<P>,
        inverses: &[Mat3],
        lambda: f64,
        cameras: &mut [SVector<f64, P>],
    ) -> Option<(f64, f64)> {
        let mut own = border.hessian * (1.0 + lambda);
        let mut right = -border.gradient;
        let mut ties = border.cameras.clone();
        for (point, (m, inverse)) in border.points.iter().zip(inverses).enumerate() {
            let mv = inverse * m;
            own -= m.dot(&mv);
            right += mv.dot(&normal.point_gradients[point]);
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    ties[slot as usize] -= normal.couplings[k] * mv;
                }
            }
        }
        let mut per_unit = ties.clone();
        self.solve(&mut per_unit);
        for ((tie, with), without) in ties.iter().zip(&per_unit).zip(cameras.iter()) {
            own -= tie.dot(with);
            right -= tie.dot(without);
        }
        let along = right / own;
        if !(own > 0.0 && along.is_finite()) {
            return None;
        }
        if !border.held {
            cameras.iter_mut().zip(&per_unit).for_each(|(c, p)| *c -= p * along);
        }
        Some((along, own))
    }

    /// Takes the points out of the cameras' system; gives the inverses of their blocks.
    fn reduce(
        &mut self,
        normal: &Normal<P>,
        damping: &impl Fn(f64) -> f64,
        right: &mut [SVector<f64, P>],
    ) -> Vec<Mat3> {
        let mut inverses = Vec::with_capacity(normal.points.len());
        let mut seen: Vec<(u32, usize, SMatrix<f64, P, 3>)> = Vec::new();
        for (point, block) in normal.points.iter().enumerate() {
            let mut damped = *block;
            (0..3).for_each(|k| damped[(k, k)] += damping(block[(k, k)]));
            // A point that nothing holds stays where it is.
            let inverse = damped.try_inverse().unwrap_or_else(Mat3::zeros);
            inverses.push(inverse);
            seen.clear();
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    let wv = normal.couplings[k] * inverse;
                    right[slot as usize] += wv * normal.point_gradients[point];
                    seen.push((slot, k, wv));
                }
            }
            for (a, _, wv) in &seen {
                for (b, k, _) in &seen {
                    if a > b {
                        let pair = self.pair(*a, *b);
                        subtract(&mut self.off[pair], wv, &normal.couplings[*k]);
                    } else if a == b {
                        subtract(&mut self.diagonal[*a as usize], wv, &normal.couplings[*k]);
                    }
                }
            }
        }
        inverses
    }
}

/// `block -= a * b^T`.
fn subtract<const P: usize>(block: &mut SMatrix<f64, P, P>, a: &SMatrix<f64, P, 3>, b: &SMatrix<f64, P, 3>) {
    for (c, column) in block.data.0.iter_mut().enumerate() {
        let (b0, b1, b2) = (b.data.0[0][c], b.data.0[1][c], b.data.0[2][c]);
        for r in 0..P {
            column[r] -= a.data.0[0][r] * b0 + a.data.0[1][r] * b1 + a.data.0[2][r] * b2;
        }
    }
}

/// By how much the linear model lowers the cost.
fn promise<const P: usize>(
    normal: &Normal<P>,
    damping: &impl Fn(f64) -> f64,
    cameras: &[SVector<f64, P>],
    points: &[Vec3],
) -> f64 {
    let of = |s: f64, g: f64, h: f64| 0.5 * s * (damping(h) * s - g);
    let mut sum = 0.0;
    for ((s, g), h) in cameras.iter().zip(&normal.camera_gradients).zip(&normal.cameras) {
        sum += (0..P).map(|k| of(s[k], g[k], h[(k, k)])).sum::<f64>();
    }
    for ((s, g), h) in points.iter().zip(&normal.point_gradients).zip(&normal.points) {
        sum += (0..3).map(|k| of(s[k], g[k], h[(k, k)])).sum::<f64>();
    }
    sum
}

fn table_of(analysis: &Analysis) -> Vec<u32> {
    let n = analysis.rows();
    let mut table = vec![0; n * n];
    for (k, (a, b)) in analysis.pairs().iter().enumerate() {
        table[*a as usize * n + *b as usize] = k as u32;
    }
    table
}

fn numbers<const P: usize>(blocks: &[SMatrix<f64, P, P>]) -> Vec<f64> {
    blocks.iter().flat_map(|b| b.iter().copied()).collect()
}
