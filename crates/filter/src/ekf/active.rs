//! The active part of the state, used by every motion and measurement: poses and nearby landmarks, with their
//! covariance.

use super::config::Linearisation;
use super::deferred::{Deferred, HEADING};
use crate::angle::wrap;
use crate::covariance::{Covariance, Rows};
use crate::measure::{Measurement, jacobians};
use crate::motion::Motion;
use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

/// Position of a variable in the active state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Place {
    pub at: usize,
    /// 3 for a pose, 2 for a landmark.
    pub size: usize,
}

/// A linearised measurement of a target.
#[derive(Clone, Debug)]
pub(crate) struct Linear {
    pub h: Rows,
    pub innovation: Vector3<f64>,
    pub noise: Matrix3<f64>,
    /// `P H^T`, in column-major order.
    pub cross: Vec<f64>,
    /// `H P H^T + R`; the identity beyond its rows.
    pub s: Matrix3<f64>,
}

impl Linear {
    /// Normalised innovation squared (NIS); `None` when the covariance of the innovation is not positive definite.
    pub fn nis(&self) -> Option<f64> {
        let cholesky = self.s.cholesky()?;
        Some(self.innovation.dot(&cholesky.solve(&self.innovation))).filter(|v| v.is_finite())
    }

    /// The same with as much more noise as brings its NIS within this bound.
    pub fn within(&self, bound: f64) -> Self {
        let mut wider = self.clone();
        while wider.nis().is_some_and(|nis| nis > bound) {
            let rows = self.h.rows;
            let more = wider.noise.map_with_location(|i, j, v| if i < rows && j < rows { v } else { 0.0 });
            (wider.s, wider.noise) = (wider.s + more, wider.noise * 2.0);
        }
        wider
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Active {
    pub x: Vec<f64>,
    /// Linearisation points: for poses the last prediction, for landmarks the first estimate (Huang, Mourikis,
    /// Roumeliotis 2010, section 5.1); in the plain filter they equal `x` whenever they are used.
    pub first: Vec<f64>,
    pub covariance: Covariance,
    /// Updates that the passive part has not received yet; `None` while everything is active.
    pub deferred: Option<Deferred>,
    linearisation: Linearisation,
    /// Which variables are angles.
    pub angles: Vec<bool>,
}

impl Active {
    pub fn new(linearisation: Linearisation) -> Self {
        Self {
            x: Vec::new(),
            first: Vec::new(),
            covariance: Covariance::default(),
            deferred: None,
            linearisation,
            angles: Vec::new(),
        }
    }

    /// Whether the filter is the invariant one, whose passive part is stored with its own errors.
    pub fn is_invariant(&self) -> bool {
        self.linearisation == Linearisation::Invariant
    }

    pub fn size(&self) -> usize {
        self.x.len()
    }

    pub fn value(&self, place: Place) -> Vector3<f64> {
        Self::of(&self.x, place)
    }

    /// The linearisation point of this variable.
    pub fn linearised_at(&self, place: Place) -> Vector3<f64> {
        Self::of(if self.linearisation == Linearisation::First { &self.first } else { &self.x }, place)
    }

    fn of(values: &[f64], place: Place) -> Vector3<f64> {
        Vector3::from_fn(|i, _| if i < place.size { values[place.at + i] } else { 0.0 })
    }

    pub fn block(&self, a: Place, b: Place) -> Matrix3<f64> {
        self.covariance.block(a.at, a.size, b.at, b.size)
    }

    /// Appends a pose that is independent of everything else.
    pub fn add_pose(&mut self, pose: &Vector3<f64>, covariance: &Matrix3<f64>) -> Place {
        let place = Place { at: self.size(), size: 3 };
        // The row is zero times the first pose, which may not exist yet.
        if self.x.is_empty() {
            self.covariance = Covariance::from_matrix(3, covariance.as_slice().to_vec());
        } else {
            self.grow(&Rows { rows: 3, blocks: Vec::new() }, covariance);
        }
        self.x.extend(pose.iter());
        self.first.extend(pose.iter());
        self.angles.extend([false, false, true]);
        place
    }

    /// Appends an exact copy of a pose (stochastic cloning, Roumeliotis and Burdick 2002).
    pub fn clone_pose(&mut self, pose: Place) -> Place {
        let place = Place { at: self.size(), size: 3 };
        let (value, first) = (self.value(pose), self.linearised_at(pose));
        self.grow(&Rows { rows: 3, blocks: vec![(pose.at, 3, Matrix3::identity())] }, &Matrix3::zeros());
        self.x.extend(value.iter());
        self.first.extend(first.iter());
        self.angles.extend([false, false, true]);
        place
    }

    /// Appends a landmark at `value` whose error is `g` times that of the state plus independent noise.
    pub fn add_landmark(&mut self, value: [f64; 2], g: &Rows, noise: &Matrix3<f64>) -> Place {
        let place = Place { at: self.size(), size: 2 };
        self.grow(g, noise);
        self.x.extend(value);
        self.first.extend(value);
        self.angles.extend([false, false]);
        place
    }

    fn grow(&mut self, g: &Rows, noise: &Matrix3<f64>) {
        self.covariance.augment(g, noise);
        if let Some(deferred) = &mut self.deferred {
            deferred.augment(g);
        }
    }

    pub fn remove(&mut self, place: Place) {
        self.covariance.remove(place.at, place.size);
        self.x.drain(place.at..place.at + place.size);
        self.first.drain(place.at..place.at + place.size);
        self.angles.drain(place.at..place.at + place.size);
        if let Some(deferred) = &mut self.deferred {
            deferred.remove(place.at, place.size);
        }
    }

    /// Propagates a pose. With first estimates the Jacobian uses the last prediction and the new one (Huang et al.
    /// 2010, equation 35), so that unobservable directions stay unobservable.
    pub fn predict(&mut self, pose: Place, motion: &Motion) {
        let (before, from) = (self.value(pose), self.linearised_at(pose));
        let (s, c) = before.z.sin_cos();
        let t = motion.before_from_after.translation;
        let (x, y) = (before.x + c * t.x - s * t.y, before.y + s * t.x + c * t.y);
        let after = [x, y, wrap(before.z + motion.before_from_after.rotation.log())];
        let f = Matrix3::new(1.0, 0.0, -(y - from.y), 0.0, 1.0, x - from.x, 0.0, 0.0, 1.0);
        let turn = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let noise = turn * motion.covariance * turn.transpose();
        self.covariance.predict(pose.at, &f, &noise);
        self.x[pose.at..pose.at + 3].copy_from_slice(&after);
        self.first[pose.at..pose.at + 3].copy_from_slice(&after);
        if let Some(deferred) = &mut self.deferred {
            deferred.predict(pose.at, &f, &noise);
        }
    }

    /// Adds noise to a pose.
    pub fn inflate(&mut self, pose: Place, q: &Matrix3<f64>) {
        self.covariance.predict(pose.at, &Matrix3::identity(), q);
        if let Some(deferred) = &mut self.deferred {
            deferred.predict(pose.at, &Matrix3::identity(), q);
        }
    }

    /// The linearised measurement of `target` from `observer`; `None` where its Jacobian is not defined.
    pub fn linear(&self, observer: Place, target: Place, m: &Measurement) -> Option<Linear> {
        let (h, innovation) = self.rows(observer, target, m)?;
        Some(self.linear_rows(h, innovation, *m.covariance()))
    }

    /// Jacobian and innovation only.
    pub fn rows(&self, observer: Place, target: Place, m: &Measurement) -> Option<(Rows, Vector3<f64>)> {
        let (at, of) = (self.linearised_at(observer), self.linearised_at(target));
        let (by_observer, by_target) = jacobians(m.kind(), &at, &of)?;
        let blocks = vec![(observer.at, 3, by_observer), (target.at, target.size, by_target)];
        let innovation = m.innovation(&self.value(observer), &self.value(target));
        Some((Rows { rows: m.kind().rows(), blocks }, innovation))
    }

    /// `H_a P H_b^T`, from the blocks that the two rows touch.
    pub fn between(&self, a: &Rows, b: &Rows) -> Matrix3<f64> {
        let mut sum = Matrix3::zeros();
        for (at, height, by_a) in &a.blocks {
            for (to, width, by_b) in &b.blocks {
                sum += by_a * self.covariance.block(*at, *height, *to, *width) * by_b.transpose();
            }
        }
        sum
    }

    /// Initialises a landmark from a measurement that determines it, with its true correlation to the rest of the
    /// state; `None` for other measurements.
    pub fn found(&mut self, observer: Place, m: &Measurement) -> Option<Place> {
        let pose = self.value(observer);
        let (target, noise) = (m.target(&pose)?, m.target_noise(&pose)?);
        let d = target - self.linearised_at(observer).xy();
        let by_pose = Matrix3::new(1.0, 0.0, -d.y, 0.0, 1.0, d.x, 0.0, 0.0, 0.0);
        let g = Rows { rows: 2, blocks: vec![(observer.at, 3, by_pose)] };
        Some(self.add_landmark(target.into(), &g, &noise.fixed_resize::<3, 3>(0.0)))
    }

    /// The linearised measurement for any rows, with their innovation and noise.
    pub fn linear_rows(&self, h: Rows, innovation: Vector3<f64>, noise: Matrix3<f64>) -> Linear {
        let (n, rows) = (self.size(), h.rows);
        let cross = self.covariance.cross(&h);
        let mut s = Matrix3::identity();
        for i in 0..rows {
            for j in 0..rows {
                let seen = h.blocks.iter().flat_map(|(at, width, values)| {
                    let cross = &cross;
                    (0..*width).map(move |k| values[(i, k)] * cross[j * n + at + k])
                });
                s[(i, j)] = noise[(i, j)] + seen.sum::<f64>();
            }
        }
        let s = 0.5 * (s + s.transpose());
        let innovation = Vector3::from_fn(|i, _| if i < rows { innovation[i] } else { 0.0 });
        Linear { h, innovation, noise, cross, s }
    }

    /// The Kalman update. Returns false, and changes nothing, when the covariance of the innovation is not positive
    /// definite.
    pub fn update(&mut self, l: &Linear) -> bool {
        let Some(moved) = self.absorb(l) else { return false };
        self.correct(&moved);
        true
    }

    /// One update by rows with unit noise and these residuals, all linearised at the present estimate. The state is
    /// corrected once, after the last row: the rows would not belong to a state that the first of them has moved.
    pub fn update_together(&mut self, rows: Vec<(Rows, f64)>) {
        let mut moved = vec![0.0; self.size()];
        for (h, residual) in rows {
            let innovation = Vector3::new(residual - h.row_times(0, &moved), 0.0, 0.0);
            let linear = self.linear_rows(h, innovation, Matrix3::identity());
            if let Some(more) = self.absorb(&linear) {
                moved.iter_mut().zip(&more).for_each(|(m, more)| *m += more);
            }
        }
        self.correct(&moved);
    }

    /// Normalised innovation squared of rows with unit noise and these residuals together; `None` when the covariance
    /// of the innovation is not positive definite.
    pub fn nis_together(&self, rows: &[(Rows, f64)]) -> Option<f64> {
        let cross: Vec<Vec<f64>> = rows.iter().map(|(h, _)| self.covariance.cross(h)).collect();
        let entry = |i: usize, j: usize| rows[i].0.row_times(0, &cross[j]) + f64::from(u8::from(i == j));
        let s = DMatrix::from_fn(rows.len(), rows.len(), |i, j| 0.5 * (entry(i, j) + entry(j, i)));
        let residual = DVector::from_iterator(rows.len(), rows.iter().map(|(_, r)| *r));
        Some(residual.dot(&s.cholesky()?.solve(&residual))).filter(|v| v.is_finite())
    }

    /// The covariance after a measurement; returns by how much it moves the state, which is left to [`Active::correct`].
    fn absorb(&mut self, l: &Linear) -> Option<Vec<f64>> {
        let (n, rows) = (self.size(), l.h.rows);
        let inverse = l.s.cholesky().map(|c| c.inverse())?;
        let (mut gain, mut moved) = (vec![0.0; n * rows], vec![0.0; n]);
        for (r, gain) in gain.chunks_exact_mut(n).enumerate() {
            for (k, cross) in l.cross.chunks_exact(n).enumerate() {
                let by = inverse[(k, r)];
                gain.iter_mut().zip(cross).for_each(|(g, c)| *g += by * c);
            }
            moved.iter_mut().zip(&*gain).for_each(|(m, g)| *m += g * l.innovation[r]);
        }
        self.covariance.update(&l.h, &l.cross, &gain, &l.noise);
        if let Some(deferred) = &mut self.deferred {
            deferred.update(&l.h, &gain, &inverse, &l.innovation);
        }
        Some(moved)
    }

    /// Moves the state by a correction.
    ///
    /// In the invariant filter the error of every position is its own error plus the heading error times the position
    /// turned by a right angle; when the position moves, the covariance in plain coordinates must change with it. `H` at
    /// the latest estimates then has the unobservable directions in its null space.
    fn correct(&mut self, moved: &[f64]) {
        self.x.iter_mut().zip(moved).for_each(|(x, m)| *x += m);
        if let Some(deferred) = &mut self.deferred {
            deferred.correct(moved[HEADING]);
        }
        if self.is_invariant() {
            self.shear_by(moved, 1.0);
        }
    }

    /// Converts the covariance between plain errors and those of the invariant filter: adds the heading error, times
    /// `sign`, times each position turned by a right angle.
    pub fn turn_errors(&mut self, sign: f64) {
        let x = std::mem::take(&mut self.x);
        self.shear_by(&x, sign);
        self.x = x;
    }

    /// Adds the heading error, times `sign`, times these positions turned by a right angle to the errors of the state.
    fn shear_by(&mut self, positions: &[f64], sign: f64) {
        let mut d = vec![0.0; positions.len()];
        let mut i = 0;
        while i < d.len() {
            if self.angles[i] {
                i += 1;
            } else {
                (d[i], d[i + 1]) = (-sign * positions[i + 1], sign * positions[i]);
                i += 2;
            }
        }
        self.covariance.shear(&d, HEADING);
        if let Some(deferred) = &mut self.deferred {
            deferred.shear(&d, HEADING);
        }
    }
}
