//! What is left of key frames that are gone: a quadratic in the others' states around where they stood then.
//!
//! Its Hessian stays as it was made, at the *first estimates* (Huang, Mourikis, Roumeliotis 2010): other factors of the same
//! states are linearised anew as those move, which slowly adds information where there is none (heading). The distance from
//! the first estimates is what [`Prior::distance`] tells; who sees it grow should drop the prior.

use super::normal::Normal;
use super::{STATE, VioFrame, VioWindow};
use nalgebra::{Cholesky, DMatrix, DVector};

/// A quadratic prior: `|J d + r|^2 / 2`, `d` the tangents from the first estimates.
#[derive(Clone, Debug)]
pub struct Prior {
    /// Indices of the window's frames it speaks of.
    frames: Vec<usize>,
    /// Where they stood when it was made.
    first: Vec<VioFrame>,
    jacobian: DMatrix<f64>,
    residual: DVector<f64>,
}

impl Prior {
    /// The indices of the frames it speaks of.
    pub fn frames(&self) -> &[usize] {
        &self.frames
    }

    /// How far the frames' places and rotations have moved from the first estimates at most: metres, rad.
    pub fn distance(&self, frames: &[VioFrame]) -> [f64; 2] {
        let parts = self.frames.iter().zip(&self.first).filter_map(|(i, first)| {
            let d = first.local(frames.get(*i)?);
            Some([d.fixed_rows::<3>(0).norm(), d.fixed_rows::<3>(3).norm()])
        });
        parts.fold([0.0; 2], |most, d| [f64::max(most[0], d[0]), f64::max(most[1], d[1])])
    }

    pub(super) fn cost(&self, frames: &[VioFrame]) -> f64 {
        0.5 * self.residual(frames).norm_squared()
    }

    /// The root of a Hessian and its gradient: what has next to no information is left out.
    fn of(frames: Vec<usize>, first: Vec<VioFrame>, h: DMatrix<f64>, b: &DVector<f64>) -> Self {
        let eigen = h.symmetric_eigen();
        let most = eigen.eigenvalues.max().max(0.0);
        let kept: Vec<usize> =
            (0..eigen.eigenvalues.len()).filter(|i| eigen.eigenvalues[*i] > 1e-12 * most).collect();
        let mut jacobian = DMatrix::zeros(kept.len(), b.len());
        let mut residual = DVector::zeros(kept.len());
        for (row, i) in kept.into_iter().enumerate() {
            let (root, vector) = (eigen.eigenvalues[i].sqrt(), eigen.eigenvectors.column(i));
            jacobian.row_mut(row).copy_from(&(vector.transpose() * root));
            residual[row] = vector.dot(b) / root;
        }
        Self { frames, first, jacobian, residual }
    }

    fn residual(&self, frames: &[VioFrame]) -> DVector<f64> {
        &self.jacobian * self.tangents(frames) + &self.residual
    }

    pub(super) fn add_to(&self, frames: &[VioFrame], h: &mut DMatrix<f64>, b: &mut DVector<f64>) {
        let gradient = self.jacobian.tr_mul(&self.residual(frames));
        let own = self.jacobian.tr_mul(&self.jacobian);
        for (i, row) in self.frames.iter().enumerate() {
            let mut part = b.fixed_rows_mut::<STATE>(row * STATE);
            part += gradient.fixed_rows::<STATE>(i * STATE);
            for (j, column) in self.frames.iter().enumerate() {
                let mut block = h.fixed_view_mut::<STATE, STATE>(row * STATE, column * STATE);
                block += own.fixed_view::<STATE, STATE>(i * STATE, j * STATE);
            }
        }
    }

    fn tangents(&self, frames: &[VioFrame]) -> DVector<f64> {
        let mut d = DVector::zeros(self.frames.len() * STATE);
        for (k, (i, first)) in self.frames.iter().zip(&self.first).enumerate() {
            d.fixed_rows_mut::<STATE>(k * STATE).copy_from(&first.local(&frames[*i]));
        }
        d
    }
}

/// See [`VioWindow::marginalise`].
pub fn marginalise(w: &mut VioWindow, frame: usize, gone: impl Fn(usize) -> bool) -> Option<()> {
    if frame >= w.frames.len() {
        return None;
    }
    let mut normal = Normal::empty(w);
    for (i, o) in w.observations.iter().enumerate() {
        if gone(o.point as usize) {
            normal.observe(w, i, true);
        }
    }
    for link in w.links.iter().filter(|l| l.from == frame || l.to == frame) {
        normal.link(w, link)?;
    }
    if let Some(prior) = &w.prior {
        prior.add_to(&w.frames, &mut normal.h, &mut normal.b);
    }
    normal.eliminate(w, 0.0, &gone);
    // The others' equations less what goes through the frame.
    let others: Vec<usize> = (0..w.frames.len()).filter(|k| *k != frame).collect();
    let take = |k: usize| k * STATE;
    let mut own = normal.h.view((take(frame), take(frame)), (STATE, STATE)).into_owned();
    let held = w.frames[frame].hold.unknowns();
    for i in 0..STATE {
        // Through what is held nothing goes.
        own[(i, i)] += if i < held { 1e15 } else { 1e-9 };
    }
    let own = Cholesky::new(own)?;
    let own_b = normal.b.rows(take(frame), STATE).into_owned();
    let n = others.len() * STATE;
    let (mut h, mut b, mut cross) = (DMatrix::zeros(n, n), DVector::zeros(n), DMatrix::zeros(STATE, n));
    for (i, from) in others.iter().enumerate() {
        b.rows_mut(i * STATE, STATE).copy_from(&normal.b.rows(take(*from), STATE));
        cross
            .view_mut((0, i * STATE), (STATE, STATE))
            .copy_from(&normal.h.view((take(frame), take(*from)), (STATE, STATE)));
        for (j, to) in others.iter().enumerate() {
            h.view_mut((i * STATE, j * STATE), (STATE, STATE))
                .copy_from(&normal.h.view((take(*from), take(*to)), (STATE, STATE)));
        }
    }
    h -= cross.transpose() * own.solve(&cross);
    b -= cross.transpose() * own.solve(&own_b);
    let closed = |k: usize| if k > frame { k - 1 } else { k };
    let kept = touched(&h, others.len());
    let part = |i: usize| kept[i / STATE] * STATE + i % STATE;
    let n = kept.len() * STATE;
    let prior = Prior::of(
        kept.iter().map(|i| closed(others[*i])).collect(),
        kept.iter().map(|i| w.frames[others[*i]]).collect(),
        DMatrix::from_fn(n, n, |i, j| h[(part(i), part(j))]),
        &DVector::from_fn(n, |i, _| b[part(i)]),
    );
    w.prior = Some(prior);
    close_up(w, frame, gone);
    Some(())
}

/// The frames of which the equations say anything.
fn touched(h: &DMatrix<f64>, n: usize) -> Vec<usize> {
    (0..n).filter(|k| (0..STATE).any(|i| h[(k * STATE + i, k * STATE + i)] > 1e-9)).collect()
}

/// Takes the frame, its links and the gone points out.
fn close_up(w: &mut VioWindow, frame: usize, gone: impl Fn(usize) -> bool) {
    let mut place = Vec::with_capacity(w.points.len());
    let mut points = Vec::new();
    for (i, p) in w.points.iter().enumerate() {
        place.push(points.len() as u32);
        if !gone(i) {
            points.push(*p);
        }
    }
    w.points = points;
    w.observations.retain(|o| o.pose as usize != frame && !gone(o.point as usize));
    for o in &mut w.observations {
        o.point = place[o.point as usize];
        o.pose -= (o.pose as usize > frame) as u32;
    }
    w.links.retain(|l| l.from != frame && l.to != frame);
    for l in &mut w.links {
        l.from -= (l.from > frame) as usize;
        l.to -= (l.to > frame) as usize;
    }
    w.frames.remove(frame);
}
