//! The normal equations of a window, block by block, and a damped step of them.
//!
//! Points are eliminated first (Triggs et al. 2000, section 6); what is left has a block for each key frame that moves and
//! for each two that see the same or follow each other, and is factored with an order that keeps it sparse.

use super::{FixedMask, STATE, VioFrame, VioLink, VioWindow, bound};
use cairn_geometry::{Mat3, Vec3};
use cairn_solve::huber;
use cairn_solve::sparse::{Analysis, Factor};
use nalgebra::{SMatrix, SVector};
use std::sync::Arc;

/// Weight of a heading that stays.
const HEADING: f64 = 1e12;
/// No block stands there.
const NONE: u32 = u32::MAX;

type Block = SMatrix<f64, STATE, STATE>;

/// Which key frames are unknown, and which of them go together: the same for all steps of a solve.
pub struct Layout {
    /// For each frame its row of blocks, when any of it moves.
    row: Vec<Option<usize>>,
    analysis: Arc<Analysis>,
    /// For each two rows where their block stands.
    pair: Vec<u32>,
}

impl Layout {
    pub fn of(w: &VioWindow) -> Self {
        let mut rows = 0;
        let mut number = |f: &VioFrame| {
            (f.hold != FixedMask::All).then(|| {
                rows += 1;
                rows - 1
            })
        };
        let row: Vec<Option<usize>> = w.frames.iter().map(&mut number).collect();
        let mut together = vec![false; rows * rows];
        let mut join = |a: usize, b: usize| {
            if let (Some(a), Some(b)) = (row[a], row[b]) {
                together[a.max(b) * rows + a.min(b)] = true;
            }
        };
        w.links.iter().for_each(|l| join(l.from, l.to));
        for views in w.observations.chunk_by(|a, b| a.point == b.point) {
            for (i, a) in views.iter().enumerate() {
                views[..i].iter().for_each(|b| join(a.pose as usize, b.pose as usize));
            }
        }
        let pairs = (0..rows * rows).filter(|i| together[*i]).map(|i| (i / rows, i % rows));
        let analysis = Analysis::new(rows, STATE, pairs);
        let mut pair = vec![NONE; rows * rows];
        for (slot, (a, b)) in analysis.pairs().iter().enumerate() {
            pair[*a as usize * rows + *b as usize] = slot as u32;
        }
        Self { row, analysis: Arc::new(analysis), pair }
    }

    pub fn analysis(&self) -> &Arc<Analysis> {
        &self.analysis
    }

    fn rows(&self) -> usize {
        self.analysis.rows()
    }
}

/// The equations of the key frames that move.
#[derive(Clone)]
struct Frames {
    diagonal: Vec<Block>,
    /// In the order of the layout's pairs: row greater than column.
    off: Vec<Block>,
    b: Vec<SVector<f64, STATE>>,
}

/// The undamped equations at one state.
pub struct Normal {
    frames: Frames,
    points: Vec<(Mat3, Vec3)>,
    /// Per observation: how pose and point go together.
    coupling: Vec<SMatrix<f64, 6, 3>>,
    pub cost: f64,
}

impl Normal {
    /// All of a window; `None` when a link has no covariance.
    pub fn of(w: &VioWindow, layout: &Layout, robust: bool) -> Option<Self> {
        let n = layout.rows();
        let frames = Frames {
            diagonal: vec![Block::zeros(); n],
            off: vec![Block::zeros(); layout.analysis.pairs().len()],
            b: vec![SVector::zeros(); n],
        };
        let mut normal = Self {
            frames,
            points: vec![(Mat3::zeros(), Vec3::zeros()); w.points.len()],
            coupling: vec![SMatrix::zeros(); w.observations.len()],
            cost: 0.0,
        };
        for i in 0..w.observations.len() {
            normal.observe(w, layout, i, robust);
        }
        for link in &w.links {
            normal.link(w, layout, link)?;
        }
        for prior in &w.bias_priors {
            let Some(row) = layout.row[prior.frame] else { continue };
            for (at, (r, by)) in [9, 12].into_iter().zip(prior.residual(&w.frames[prior.frame].bias)) {
                normal.cost += 0.5 * r.norm_squared();
                for i in 0..3 {
                    normal.frames.diagonal[row][(at + i, at + i)] += by * by;
                    normal.frames.b[row][at + i] += by * r[i];
                }
            }
        }
        Some(normal)
    }

    fn observe(&mut self, w: &VioWindow, layout: &Layout, index: usize, robust: bool) {
        let o = &w.observations[index];
        let (pose, point) = (o.pose as usize, o.point as usize);
        if o.weight <= 0.0 {
            return;
        }
        let Some(l) = w.camera.reproject(&w.frames[pose].world_from_camera, &w.points[point], &o.pixel)
        else {
            return;
        };
        let r = Vec3::from(l.residual);
        let chi2 = r.norm_squared() * o.weight;
        let (loss, slope) = if robust { huber(chi2, bound(o)) } else { (chi2, 1.0) };
        self.cost += 0.5 * loss;
        let weight = slope * o.weight;
        let by_pose = SMatrix::<f64, 3, 6>::from_fn(|i, j| l.by_pose[i][j]);
        let by_point = Mat3::from_fn(|i, j| l.by_point[i][j]);
        let (h, b) = &mut self.points[point];
        *h += by_point.transpose() * by_point * weight;
        *b += by_point.transpose() * r * weight;
        let Some(row) = layout.row[pose] else { return };
        let mut block = self.frames.diagonal[row].fixed_view_mut::<6, 6>(0, 0);
        block += by_pose.transpose() * by_pose * weight;
        let mut gradient = self.frames.b[row].fixed_rows_mut::<6>(0);
        gradient += by_pose.transpose() * r * weight;
        self.coupling[index] = by_pose.transpose() * by_point * weight;
    }

    fn link(&mut self, w: &VioWindow, layout: &Layout, link: &VioLink) -> Option<()> {
        let nav = |i: usize| w.frames[i].nav(&w.imu_from_camera);
        let l = link.sum.linearise(&nav(link.from), &nav(link.to), &w.gravity);
        let white = link.sum.whitening()?;
        let adjoint = w.imu_from_camera.adjoint();
        let to_camera = |by: &Block| {
            let mut out = *by;
            let pose: SMatrix<f64, STATE, 6> = by.fixed_view::<STATE, 6>(0, 0).into();
            out.fixed_view_mut::<STATE, 6>(0, 0).copy_from(&(pose * adjoint));
            white * out
        };
        let r = white * l.residual;
        self.cost += 0.5 * r.norm_squared();
        let parts =
            [(layout.row[link.from], to_camera(&l.by_from)), (layout.row[link.to], to_camera(&l.by_to))];
        for (row, by) in parts.iter().filter_map(|(row, by)| Some(((*row)?, by))) {
            self.frames.b[row] += by.transpose() * r;
            self.frames.diagonal[row] += by.transpose() * by;
        }
        if let [(Some(a), by_a), (Some(b), by_b)] = parts {
            let (row, column, block) = match a > b {
                true => (a, b, by_a.transpose() * by_b),
                false => (b, a, by_b.transpose() * by_a),
            };
            let slot = layout.pair[row * layout.rows() + column];
            self.frames.off.get_mut(slot as usize).into_iter().for_each(|off| *off += block);
        }
        Some(())
    }

    /// The frames' equations without the points; gives the points' inverted Hessians, damped by `lambda`.
    fn eliminate(&self, w: &VioWindow, layout: &Layout, lambda: f64) -> (Frames, Vec<Mat3>) {
        let inverse: Vec<Mat3> = self
            .points
            .iter()
            .map(|(h, _)| {
                let mut d = *h;
                for a in 0..3 {
                    d[(a, a)] += lambda * h[(a, a)] + 1e-9;
                }
                d.try_inverse().unwrap_or_else(Mat3::zeros)
            })
            .collect();
        let mut left = self.frames.clone();
        let mut start = 0;
        for views in w.observations.chunk_by(|a, b| a.point == b.point) {
            let couplings = &self.coupling[start..start + views.len()];
            start += views.len();
            let point = views[0].point as usize;
            let (v, g) = (&inverse[point], &self.points[point].1);
            for (o, coupling) in views.iter().zip(couplings) {
                let Some(row) = layout.row[o.pose as usize] else { continue };
                let weighted = coupling * v;
                let mut gradient = left.b[row].fixed_rows_mut::<6>(0);
                gradient -= weighted * g;
                for (p, other) in views.iter().zip(couplings) {
                    let Some(column) = layout.row[p.pose as usize].filter(|c| *c <= row) else { continue };
                    let block = match column == row {
                        true => &mut left.diagonal[row],
                        false => &mut left.off[layout.pair[row * layout.rows() + column] as usize],
                    };
                    let mut part = block.fixed_view_mut::<6, 6>(0, 0);
                    part -= weighted * other.transpose();
                }
            }
        }
        (left, inverse)
    }

    /// Frames and points after a damped step; `None` when the equations are singular.
    pub fn step(
        &self,
        w: &VioWindow,
        layout: &Layout,
        factor: &mut Factor,
        lambda: f64,
    ) -> Option<(Vec<VioFrame>, Vec<Vec3>)> {
        let (mut left, inverse) = self.eliminate(w, layout, lambda);
        for (block, whole) in left.diagonal.iter_mut().zip(&self.frames.diagonal) {
            for i in 0..STATE {
                block[(i, i)] += lambda * whole[(i, i)] + 1e-9;
            }
        }
        hold(w, layout, &mut left);
        factor.factor(&numbers(&left.diagonal), &numbers(&left.off)).ok()?;
        let mut steps: Vec<f64> = left.b.iter().flat_map(|b| b.iter().map(|v| -v)).collect();
        factor.solve(&mut steps);
        let step = |k: usize| match layout.row[k] {
            Some(row) => SVector::<f64, STATE>::from_column_slice(&steps[row * STATE..][..STATE]),
            None => SVector::zeros(),
        };
        let frames = w.frames.iter().enumerate().map(|(k, f)| f.moved(&step(k))).collect();
        let mut back: Vec<Vec3> = self.points.iter().map(|(_, g)| -g).collect();
        for (o, c) in w.observations.iter().zip(&self.coupling) {
            back[o.point as usize] -= c.transpose() * step(o.pose as usize).fixed_rows::<6>(0);
        }
        let points = w.points.iter().zip(&back).zip(&inverse).map(|((p, b), v)| p + v * b).collect();
        Some((frames, points))
    }
}

/// What stays of frames that move in part is taken out.
fn hold(w: &VioWindow, layout: &Layout, left: &mut Frames) {
    let moving = || w.frames.iter().zip(&layout.row).filter_map(|(f, row)| Some((f, (*row)?)));
    let mut held: Vec<std::ops::Range<usize>> = vec![0..0; layout.rows()];
    for (frame, row) in moving() {
        if frame.hold == FixedMask::Place {
            let up = frame.world_from_camera.rotation.inverse() * (-w.gravity.vector().normalize());
            let mut turns = left.diagonal[row].fixed_view_mut::<3, 3>(3, 3);
            turns += up * up.transpose() * HEADING;
        }
        held[row] = frame.hold.unknowns();
        for i in held[row].clone() {
            left.diagonal[row].row_mut(i).fill(0.0);
            left.diagonal[row].column_mut(i).fill(0.0);
            left.diagonal[row][(i, i)] = 1.0;
            left.b[row][i] = 0.0;
        }
    }
    for ((a, b), block) in layout.analysis.pairs().iter().zip(&mut left.off) {
        held[*a as usize].clone().for_each(|i| block.row_mut(i).fill(0.0));
        held[*b as usize].clone().for_each(|i| block.column_mut(i).fill(0.0));
    }
}

fn numbers(blocks: &[Block]) -> Vec<f64> {
    blocks.iter().flat_map(|b| b.as_slice().iter().copied()).collect()
}
