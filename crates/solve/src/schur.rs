//! Cameras, points and further variables: the points are eliminated, the rest solved sparsely, the points found from it.
//!
//! The reduced system has one block row for each free camera, then one for each further variable (velocities and biases,
//! say), which no point touches. Blocks are stored by columns.
//!
//! Source: Triggs et al., "Bundle adjustment: a modern synthesis" (2000), section 6.

mod normal;
mod pattern;
mod reduced;

pub use normal::Normal;

use crate::slices::pause;
use crate::sparse::{Analysis, Factor};
use cairn_geometry::{Mat3, Vec3};
use nalgebra::{DMatrix, SMatrix, SVector};
use pattern::{Pattern, covisible, table_of};
use reduced::Reduced;
use std::ops::Range;
use std::sync::Arc;

/// Which camera observes which point, and which variables share a factor, analysed; cameras have `P` parameters.
pub struct Schur<const P: usize> {
    /// The observations of each point.
    ranges: Vec<Range<usize>>,
    /// Block row of the camera of each observation, where that is free.
    slots: Vec<Option<u32>>,
    pattern: Arc<Pattern>,
    /// Components of variables that stay: (block row, components).
    held: Vec<(usize, Range<usize>)>,
    factor: Factor,
    /// Index of the block of two cameras, where there are few enough for a table.
    table: Vec<u32>,
    reduced: Reduced<P>,
}

/// A step of all free cameras, further variables and points, and by how much the linear model lowers the cost.
pub struct Step<const P: usize> {
    pub cameras: Vec<SVector<f64, P>>,
    /// Of the further variables, one after the other.
    pub more: Vec<f64>,
    pub points: Vec<Vec3>,
    /// Of each border.
    pub borders: Vec<BorderStep>,
    pub promise: f64,
}

/// The step of a border.
#[derive(Clone, Copy, Debug)]
pub struct BorderStep {
    /// Zero where it is held.
    pub step: f64,
    /// How far it would move if it were not held.
    pub pull: f64,
    /// Information on it with everything else marginalised but other borders that are held: the inverse of its variance.
    pub information: f64,
}

/// One more unknown, coupled to any camera and point: its own entry, gradient, and couplings.
#[derive(Clone, Default)]
pub struct Border<const P: usize> {
    pub hessian: f64,
    pub gradient: f64,
    /// With each border before it.
    pub earlier: Vec<f64>,
    /// With each free camera.
    pub cameras: Vec<SVector<f64, P>>,
    /// With each point.
    pub points: Vec<Vec3>,
    /// True to compute only how far it would move; it and everything else take the step without it.
    pub held: bool,
}

/// Variables beside cameras and points, and factors beside observations; block rows number cameras first.
#[derive(Clone, Debug, Default)]
pub struct More {
    /// Unknowns of each further variable.
    pub sizes: Vec<usize>,
    /// Block rows that share a factor.
    pub pairs: Vec<(usize, usize)>,
    /// Components of block rows that stay.
    pub held: Vec<(usize, Range<usize>)>,
}

/// Points that are eliminated in one slice: about a millisecond where twenty cameras see each.
const POINTS_IN_SLICE: usize = 128;
/// Most free cameras for which a table of pairs is kept.
const TABLE: usize = 1024;

impl<const P: usize> Schur<P> {
    /// Of `cameras` free cameras and observations grouped by point (those of a point stand together): the point of each,
    /// below `points`, and the block row of its camera, where that is free; and of further variables and factors.
    pub fn new(
        cameras: usize,
        points: usize,
        observations: impl Iterator<Item = (usize, Option<u32>)>,
        more: More,
    ) -> Self {
        let (mut ranges, mut slots) = (vec![0..0; points], Vec::new());
        for (k, (point, slot)) in observations.enumerate() {
            let start = if ranges[point].is_empty() { k } else { ranges[point].start };
            ranges[point] = start..k + 1;
            slots.push(slot);
        }
        let shared = covisible(cameras, &ranges, &slots);
        let pairs =
            shared.iter().enumerate().flat_map(|(a, list)| list.iter().map(move |b| (a, *b as usize)));
        let sizes = vec![P; cameras].into_iter().chain(more.sizes).collect();
        let analysis = Analysis::with_sizes(sizes, pairs.chain(more.pairs.iter().copied()));
        drop(shared);
        let pattern = Arc::new(Pattern::new(analysis, cameras, &more.pairs));
        let numbers = |starts: &[usize]| vec![0.0; starts.last().copied().unwrap_or(0)];
        Self {
            ranges,
            slots,
            table: if cameras <= TABLE { table_of(&pattern) } else { Vec::new() },
            held: more.held,
            reduced: Reduced {
                diagonal: vec![SMatrix::zeros(); cameras],
                off: vec![SMatrix::zeros(); pattern.camera_pairs],
                more_diagonal: numbers(&pattern.diagonal_start),
                more_off: numbers(&pattern.off_start),
                pattern: Arc::clone(&pattern),
            },
            factor: Factor::new(Arc::clone(&pattern.analysis)),
            pattern,
        }
    }

    /// Block rows of the reduced system.
    pub fn rows(&self) -> usize {
        self.pattern.analysis.rows()
    }

    /// Normal equations of zeros.
    pub fn normal(&self) -> Normal<P> {
        let (r, links) = (&self.reduced, self.pattern.camera_links.len());
        Normal {
            cameras: vec![SMatrix::zeros(); self.pattern.cameras],
            camera_gradients: vec![SVector::zeros(); self.pattern.cameras],
            points: vec![Mat3::zeros(); self.ranges.len()],
            point_gradients: vec![Vec3::zeros(); self.ranges.len()],
            cost: 0.0,
            camera_links: vec![SMatrix::zeros(); links],
            more_gradient: vec![0.0; self.pattern.analysis.dimension() - P * self.pattern.cameras],
            more_diagonal: vec![0.0; r.more_diagonal.len()],
            more_off: vec![0.0; r.more_off.len()],
            pattern: Arc::clone(&self.pattern),
        }
    }

    /// The range of a point's observations.
    fn observations(&self, point: usize) -> Range<usize> {
        self.ranges[point].clone()
    }

    /// Index of the block of two cameras, the first of higher place.
    fn pair(&self, a: u32, b: u32) -> usize {
        if self.table.is_empty() {
            return self.pattern.pair(a as usize, b as usize);
        }
        self.table[a as usize * self.pattern.cameras + b as usize] as usize
    }

    /// The step with every diagonal entry raised by `lambda` of itself and `floor`; `None` when it is singular.
    ///
    /// `coupling` gives an observation's block of the normal equations, camera by point. There are more of them than of
    /// everything else, and each is needed twice or three times in a step only: so they need not be stored.
    pub async fn step(
        &mut self,
        normal: &Normal<P>,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        borders: &[Border<P>],
        lambda: f64,
        floor: f64,
    ) -> Option<Step<P>> {
        let damping = |h: f64| lambda * h + floor;
        let (mut right, inverses) = self.factor_reduced(normal, coupling, &damping).await?;
        pause().await;
        self.factor.solve(&mut right);
        let steps = self.border_steps(normal, coupling, borders, &inverses, lambda, &mut right)?;
        pause().await;
        let moving = || borders.iter().zip(&steps).filter(|(border, _)| !border.held);
        let more = right.split_off(P * self.pattern.cameras);
        let cameras: Vec<SVector<f64, P>> = right.chunks_exact(P).map(SVector::from_column_slice).collect();
        let mut points: Vec<Vec3> = Vec::with_capacity(inverses.len());
        for (point, inverse) in inverses.iter().enumerate() {
            let mut rest = -normal.point_gradients[point];
            moving().for_each(|(border, s)| rest -= border.points[point] * s.step);
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    rest -= coupling(k).tr_mul(&cameras[slot as usize]);
                }
            }
            points.push(inverse * rest);
        }
        let mut promise =
            promise(normal, &damping, &cameras, &points) + self.more_promise(normal, &damping, &more);
        for (border, BorderStep { step, .. }) in moving() {
            promise += 0.5 * step * (lambda * border.hessian * step - border.gradient);
        }
        promise.is_finite().then_some(Step { cameras, more, points, borders: steps, promise })
    }

    /// Covariance of a free camera's parameters with everything else marginalised, from the undamped equations (raised by
    /// `floor` on the diagonal); `None` when they are singular.
    pub async fn covariance(
        &mut self,
        normal: &Normal<P>,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        camera: usize,
        floor: f64,
    ) -> Option<SMatrix<f64, P, P>> {
        let (right, _) = self.factor_reduced(normal, coupling, &|_| floor).await?;
        let at = self.pattern.analysis.offset(camera);
        let mut covariance = SMatrix::<f64, P, P>::zeros();
        for k in 0..P {
            let mut unit = vec![0.0; right.len()];
            unit[at + k] = 1.0;
            self.factor.solve(&mut unit);
            covariance.column_mut(k).copy_from_slice(&unit[at..at + P]);
        }
        Some(covariance)
    }

    /// Eliminates the points and factors what is left; its right-hand side, and the inverses of the points' blocks.
    async fn factor_reduced(
        &mut self,
        normal: &Normal<P>,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        damping: &impl Fn(f64) -> f64,
    ) -> Option<(Vec<f64>, Vec<Mat3>)> {
        let reduced = &mut self.reduced;
        reduced.off.fill(SMatrix::zeros());
        for (pair, block) in self.pattern.camera_links.iter().zip(&normal.camera_links) {
            reduced.off[*pair as usize] = *block;
        }
        reduced.diagonal.copy_from_slice(&normal.cameras);
        reduced.more_diagonal.copy_from_slice(&normal.more_diagonal);
        reduced.more_off.copy_from_slice(&normal.more_off);
        for block in &mut reduced.diagonal {
            (0..P).for_each(|k| block[(k, k)] += damping(block[(k, k)]));
        }
        for (k, row) in (self.pattern.cameras..self.pattern.analysis.rows()).enumerate() {
            let d = self.pattern.analysis.size(row);
            let block = &mut reduced.more_diagonal[self.pattern.diagonal_start[k]..];
            (0..d).for_each(|i| block[i * d + i] += damping(block[i * d + i]));
        }
        let mut cameras: Vec<SVector<f64, P>> = normal.camera_gradients.iter().map(|g| -g).collect();
        let inverses = self.reduce(normal, coupling, damping, &mut cameras).await;
        let mut right: Vec<f64> = cameras.iter().flat_map(|v| v.iter().copied()).collect();
        right.extend(normal.more_gradient.iter().map(|g| -g));
        for (row, components) in &self.held {
            self.reduced.hold(*row, components, &mut right);
        }
        pause().await;
        self.factor.factor(&self.reduced).ok()?;
        Some((right, inverses))
    }

    fn more_promise(&self, normal: &Normal<P>, damping: &impl Fn(f64) -> f64, more: &[f64]) -> f64 {
        let mut sum = 0.0;
        for (k, row) in (self.pattern.cameras..self.pattern.analysis.rows()).enumerate() {
            let (d, at) = (self.pattern.analysis.size(row), self.pattern.gradient_start(row));
            let block = &normal.more_diagonal[self.pattern.diagonal_start[k]..];
            for i in 0..d {
                let (s, g, h) = (more[at + i], normal.more_gradient[at + i], block[i * d + i]);
                sum += 0.5 * s * (damping(h) * s - g);
            }
        }
        sum
    }

    /// The steps of the borders, and what those that are not held change in that of the cameras, which holds the step without
    /// them: block elimination of the last rows of the reduced system.
    fn border_steps(
        &self,
        normal: &Normal<P>,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        borders: &[Border<P>],
        inverses: &[Mat3],
        lambda: f64,
        solution: &mut [f64],
    ) -> Option<Vec<BorderStep>> {
        let mut last = LastRows::default();
        let (mut ties, mut per_unit): (Vec<Vec<f64>>, Vec<Vec<f64>>) = (Vec::new(), Vec::new());
        for border in borders {
            let (mut own, mut right) = (border.hessian * (1.0 + lambda), -border.gradient);
            let mut earlier = border.earlier.clone();
            for (point, (m, inverse)) in border.points.iter().zip(inverses).enumerate() {
                let mv = inverse * m;
                own -= m.dot(&mv);
                right += mv.dot(&normal.point_gradients[point]);
                earlier.iter_mut().zip(borders).for_each(|(e, other)| *e -= other.points[point].dot(&mv));
            }
            let tie = self.tie(coupling, border, inverses, solution.len());
            let mut unit = tie.clone();
            self.factor.solve(&mut unit);
            own = self.less_by_cameras(own, &tie, &unit);
            right = self.less_by_cameras(right, &tie, solution);
            for (e, other) in earlier.iter_mut().zip(&ties) {
                *e = self.less_by_cameras(*e, other, &unit);
            }
            earlier.push(own);
            last.rows.push(earlier);
            last.right.push(right);
            ties.push(tie);
            per_unit.push(unit);
        }
        let free: Vec<usize> = (0..borders.len()).filter(|i| !borders[*i].held).collect();
        let steps: Vec<BorderStep> =
            (0..borders.len()).map(|i| last.step(i, &free)).collect::<Option<_>>()?;
        for i in free {
            solution.iter_mut().zip(&per_unit[i]).for_each(|(c, p)| *c -= p * steps[i].step);
        }
        Some(steps)
    }

    /// The couplings of a border in the reduced system, with all its block rows.
    fn tie(
        &self,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        border: &Border<P>,
        inverses: &[Mat3],
        rows: usize,
    ) -> Vec<f64> {
        let mut ties = border.cameras.clone();
        for (point, (m, inverse)) in border.points.iter().zip(inverses).enumerate() {
            let mv = inverse * m;
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    ties[slot as usize] -= coupling(k) * mv;
                }
            }
        }
        let mut ties: Vec<f64> = ties.iter().flat_map(|v| v.iter().copied()).collect();
        ties.resize(rows, 0.0);
        for (row, components) in &self.held {
            let at = self.pattern.analysis.offset(*row);
            ties[at + components.start..at + components.end].fill(0.0);
        }
        ties
    }

    /// A number less the product of two columns; nothing but cameras is coupled to a border.
    fn less_by_cameras(&self, number: f64, a: &[f64], b: &[f64]) -> f64 {
        let of = |c: &[f64]| SVector::<f64, P>::from_column_slice(c);
        let cameras = a.chunks(P).zip(b.chunks(P)).take(self.pattern.cameras);
        cameras.fold(number, |left, (a, b)| left - of(a).dot(&of(b)))
    }

    /// Eliminates the points from the cameras' system; returns the inverses of their blocks.
    async fn reduce(
        &mut self,
        normal: &Normal<P>,
        coupling: &impl Fn(usize) -> SMatrix<f64, P, 3>,
        damping: &impl Fn(f64) -> f64,
        right: &mut [SVector<f64, P>],
    ) -> Vec<Mat3> {
        let mut inverses = Vec::with_capacity(normal.points.len());
        // Of each observation of a point: the camera, the coupling, and that times the point's inverse.
        let mut seen: Vec<(u32, SMatrix<f64, P, 3>, SMatrix<f64, P, 3>)> = Vec::new();
        for (point, block) in normal.points.iter().enumerate() {
            if (point + 1).is_multiple_of(POINTS_IN_SLICE) {
                pause().await;
            }
            let mut damped = *block;
            (0..3).for_each(|k| damped[(k, k)] += damping(block[(k, k)]));
            // A point that nothing constrains stays where it is.
            let inverse = damped.try_inverse().unwrap_or_else(Mat3::zeros);
            inverses.push(inverse);
            seen.clear();
            for k in self.observations(point) {
                if let Some(slot) = self.slots[k] {
                    let w = coupling(k);
                    let wv = w * inverse;
                    right[slot as usize] += wv * normal.point_gradients[point];
                    seen.push((slot, w, wv));
                }
            }
            for (a, _, wv) in &seen {
                for (b, w, _) in &seen {
                    if a > b {
                        let pair = self.pair(*a, *b);
                        subtract(&mut self.reduced.off[pair], wv, w);
                    } else if a == b {
                        subtract(&mut self.reduced.diagonal[*a as usize], wv, w);
                    }
                }
            }
        }
        inverses
    }
}

/// The borders' rows of the reduced system, with everything before them eliminated: the lower triangle, and the right side.
#[derive(Default)]
struct LastRows {
    rows: Vec<Vec<f64>>,
    right: Vec<f64>,
}

impl LastRows {
    fn entry(&self, a: usize, b: usize) -> f64 {
        self.rows[a.max(b)][a.min(b)]
    }

    /// The step of one where it and the free ones move: Gaussian elimination that leaves it for the end.
    fn step(&self, this: usize, free: &[usize]) -> Option<BorderStep> {
        let order: Vec<usize> = free.iter().copied().filter(|i| *i != this).chain([this]).collect();
        let n = order.len();
        let mut m = DMatrix::from_fn(n, n, |i, j| self.entry(order[i], order[j]));
        let mut right: Vec<f64> = order.iter().map(|i| self.right[*i]).collect();
        for pivot in 0..n - 1 {
            for row in pivot + 1..n {
                let by = m[(row, pivot)] / m[(pivot, pivot)];
                (pivot..n).for_each(|c| m[(row, c)] -= by * m[(pivot, c)]);
                right[row] -= by * right[pivot];
            }
        }
        let information = m[(n - 1, n - 1)];
        let pull = right[n - 1] / information;
        let step = if free.contains(&this) { pull } else { 0.0 };
        (information > 0.0 && pull.is_finite()).then_some(BorderStep { step, pull, information })
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
