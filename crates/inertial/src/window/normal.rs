//! The normal equations of a window, and a damped step of them.

use super::{Hold, STATE, VioFrame, VioLink, VioWindow, bound};
use cairn_geometry::{Mat3, Vec3};
use cairn_solve::huber;
use nalgebra::{Cholesky, DMatrix, DVector, SMatrix, SVector};

/// Weight of a heading that stays.
const HEADING: f64 = 1e12;

/// The undamped equations at one state; the frames' Hessian is whole, both triangles.
pub struct Normal {
    pub h: DMatrix<f64>,
    pub b: DVector<f64>,
    pub points: Vec<(Mat3, Vec3)>,
    /// Per observation: how pose and point go together.
    pub coupling: Vec<SMatrix<f64, 6, 3>>,
    pub cost: f64,
}

impl Normal {
    /// Zero equations of a window's size.
    pub fn empty(w: &VioWindow) -> Self {
        let n = w.frames.len() * STATE;
        Self {
            h: DMatrix::zeros(n, n),
            b: DVector::zeros(n),
            points: vec![(Mat3::zeros(), Vec3::zeros()); w.points.len()],
            coupling: vec![SMatrix::zeros(); w.observations.len()],
            cost: 0.0,
        }
    }

    /// All of a window; `None` when a link has no covariance.
    pub fn of(w: &VioWindow, robust: bool) -> Option<Self> {
        let mut normal = Self::empty(w);
        for i in 0..w.observations.len() {
            normal.observe(w, i, robust);
        }
        for link in &w.links {
            normal.link(w, link)?;
        }
        Some(normal)
    }

    /// Adds an observation.
    pub fn observe(&mut self, w: &VioWindow, index: usize, robust: bool) {
        let o = &w.observations[index];
        let (pose, point) = (o.pose as usize, o.point as usize);
        if o.weight <= 0.0 {
            return;
        }
        let Some(l) = w.camera.reproject(&w.frames[pose].world_from_eye, &w.points[point], &o.pixel) else {
            return;
        };
        let r = Vec3::from(l.residual);
        let chi2 = r.norm_squared() * o.weight;
        let (loss, slope) = if robust { huber(chi2, bound(o)) } else { (chi2, 1.0) };
        self.cost += 0.5 * loss;
        let weight = slope * o.weight;
        let by_pose = SMatrix::<f64, 3, 6>::from_fn(|i, j| l.by_pose[i][j]);
        let by_point = Mat3::from_fn(|i, j| l.by_point[i][j]);
        let at = pose * STATE;
        let mut block = self.h.fixed_view_mut::<6, 6>(at, at);
        block += by_pose.transpose() * by_pose * weight;
        let mut gradient = self.b.fixed_rows_mut::<6>(at);
        gradient += by_pose.transpose() * r * weight;
        let (h, b) = &mut self.points[point];
        *h += by_point.transpose() * by_point * weight;
        *b += by_point.transpose() * r * weight;
        self.coupling[index] = by_pose.transpose() * by_point * weight;
    }

    /// Adds a link.
    pub fn link(&mut self, w: &VioWindow, link: &VioLink) -> Option<()> {
        let nav = |i: usize| w.frames[i].nav(&w.imu_from_eye);
        let l = link.sum.linearise(&nav(link.from), &nav(link.to), &w.gravity);
        let white = link.sum.whitening()?;
        let adjoint = w.imu_from_eye.adjoint();
        let to_eye = |by: &SMatrix<f64, STATE, STATE>| {
            let mut out = *by;
            let pose: SMatrix<f64, STATE, 6> = by.fixed_view::<STATE, 6>(0, 0).into();
            out.fixed_view_mut::<STATE, 6>(0, 0).copy_from(&(pose * adjoint));
            white * out
        };
        let (from, to) = (to_eye(&l.by_from), to_eye(&l.by_to));
        let r = white * l.residual;
        self.cost += 0.5 * r.norm_squared();
        let parts = [(link.from * STATE, from), (link.to * STATE, to)];
        for (row, a) in &parts {
            let mut gradient = self.b.fixed_rows_mut::<STATE>(*row);
            gradient += a.transpose() * r;
            for (column, b) in &parts {
                let mut block = self.h.fixed_view_mut::<STATE, STATE>(*row, *column);
                block += a.transpose() * b;
            }
        }
        Some(())
    }

    /// Takes the points for which `which` says so into the frames' equations; gives their inverted Hessians, damped by `lambda`.
    pub fn eliminate(&mut self, w: &VioWindow, lambda: f64, which: impl Fn(usize) -> bool) -> Vec<Mat3> {
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
        let mut start = 0;
        while start < w.observations.len() {
            let point = w.observations[start].point;
            let end = start + w.observations[start..].iter().take_while(|o| o.point == point).count();
            if which(point as usize) {
                let v = &inverse[point as usize];
                let g = self.points[point as usize].1;
                for i in start..end {
                    let weighted = self.coupling[i] * v;
                    let row = w.observations[i].pose as usize * STATE;
                    let mut gradient = self.b.fixed_rows_mut::<6>(row);
                    gradient -= weighted * g;
                    for j in start..end {
                        let column = w.observations[j].pose as usize * STATE;
                        let mut block = self.h.fixed_view_mut::<6, 6>(row, column);
                        block -= weighted * self.coupling[j].transpose();
                    }
                }
            }
            start = end;
        }
        inverse
    }

    /// Frames and points after a damped step; `None` when the equations are singular.
    pub fn step(&self, w: &VioWindow, lambda: f64) -> Option<(Vec<VioFrame>, Vec<Vec3>)> {
        let mut reduced = Self {
            h: self.h.clone(),
            b: self.b.clone(),
            points: self.points.clone(),
            coupling: self.coupling.clone(),
            cost: 0.0,
        };
        for i in 0..reduced.b.len() {
            reduced.h[(i, i)] += lambda * self.h[(i, i)] + 1e-9;
        }
        let inverse = reduced.eliminate(w, lambda, |_| true);
        for (k, frame) in w.frames.iter().enumerate() {
            if frame.hold == Hold::Place {
                let up = frame.world_from_eye.rotation.inverse() * (-w.gravity.vector().normalize());
                let mut turns = reduced.h.fixed_view_mut::<3, 3>(k * STATE + 3, k * STATE + 3);
                turns += up * up.transpose() * HEADING;
            }
            for i in frame.hold.unknowns().map(|i| k * STATE + i) {
                reduced.h.row_mut(i).fill(0.0);
                reduced.h.column_mut(i).fill(0.0);
                reduced.h[(i, i)] = 1.0;
                reduced.b[i] = 0.0;
            }
        }
        let steps = -Cholesky::new(reduced.h)?.solve(&reduced.b);
        let step = |k: usize| -> SVector<f64, STATE> { steps.fixed_rows::<STATE>(k * STATE).into() };
        let frames = w.frames.iter().enumerate().map(|(k, f)| f.moved(&step(k))).collect();
        let mut back: Vec<Vec3> = self.points.iter().map(|(_, g)| -g).collect();
        for (o, c) in w.observations.iter().zip(&self.coupling) {
            back[o.point as usize] -= c.transpose() * steps.fixed_rows::<6>(o.pose as usize * STATE);
        }
        let points = w.points.iter().zip(&back).zip(&inverse).map(|((p, b), v)| p + v * b).collect();
        Some((frames, points))
    }
}
