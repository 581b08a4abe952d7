//! The passive part of the map, far from the robot, and the updates to apply to it when the robot returns.
//!
//! Source: Guivant and Nebot (2001), equations of the compressed filter. While a region is active its covariance `P_AA`
//! is updated as usual; for the rest only three small matrices are kept: `phi`, the transition of the errors that were
//! active at the start, `psi`, the information gained about them, and `theta`, the resulting correction of the state.
//! With `W = P_BA` at the start: `P_AB = phi W^T`, `P_BB -= W psi W^T`, `x_B += W theta`. They grow with the region,
//! not with the map.

use super::active::{Active, HEADING, Place};
use super::deferred::Deferred;
use super::tiles::Tiles;
use crate::covariance::{Covariance, Form};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use std::collections::BTreeSet;

/// Number of updates over which a subtraction from the passive part is spread.
const SPREAD: usize = 20;

/// A variable of the map: its place in the active state, and its first index in the passive store.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Member {
    pub place: Place,
    pub store: usize,
}

/// The passive part of the state.
#[derive(Clone, Debug, Default)]
pub(crate) struct Passive {
    covariance: Tiles,
    x: Vec<f64>,
    first: Vec<f64>,
    /// Rows of the active region against everything, as they were when it became active: `W`.
    cross: DMatrix<f64>,
    free: Vec<usize>,
    /// First indices of all landmarks.
    landmarks: BTreeSet<usize>,
}

impl Passive {
    /// Allocates indices for a variable of this size; those of removed landmarks are used again.
    pub fn allot(&mut self, size: usize) -> usize {
        if let (2, Some(store)) = (size, self.free.pop()) {
            self.landmarks.insert(store);
            return store;
        }
        let store = self.x.len();
        if size == 2 {
            self.landmarks.insert(store);
        }
        self.x.resize(store + size, 0.0);
        self.first.resize(store + size, 0.0);
        self.covariance.reserve(self.x.len());
        store
    }

    /// Releases the indices of a landmark.
    pub fn release(&mut self, store: usize) {
        self.landmarks.remove(&store);
        self.free.push(store);
    }

    /// Stores the active part again; `members` are all its variables.
    pub fn close(&mut self, active: &mut Active, members: &[Member]) {
        let n = self.x.len();
        let numbers: Vec<(usize, usize)> =
            members.iter().flat_map(|m| (0..m.place.size).map(|k| (m.place.at + k, m.store + k))).collect();
        let stored: Vec<usize> = numbers.iter().map(|(_, store)| *store).collect();
        let mut rows = DMatrix::zeros(n, numbers.len());
        if let Some(deferred) = active.deferred.take() {
            // The store may have grown; new variables were active only.
            let mut cross =
                std::mem::replace(&mut self.cross, DMatrix::zeros(0, 0)).resize_vertically(n, 0.0);
            for &store in &stored {
                cross.row_mut(store).fill(0.0);
            }
            let width = deferred.theta.len();
            let phi = DMatrix::from_fn(width, numbers.len(), |c, k| deferred.phi[numbers[k].0][c]);
            rows.gemm(1.0, &cross, &phi, 0.0);
            let moved = &cross * &deferred.theta;
            self.x.iter_mut().zip(moved.iter()).for_each(|(x, m)| *x += m);
            let left = &cross * &deferred.psi;
            self.covariance.subtract(left, cross);
            if active.is_invariant() {
                self.turn_errors(&moved, &numbers, active, &mut rows);
            }
        }
        let matrix = active.covariance.matrix();
        let size = active.size();
        for (k, &(at, store)) in numbers.iter().enumerate() {
            (self.x[store], self.first[store]) = (active.x[at], active.first[at]);
            for &(other, to) in &numbers {
                rows[(to, k)] = matrix[at * size + other];
            }
        }
        self.covariance.write(&stored, &rows);
    }

    /// What [`Active`] does after each correction, for the passive part at once, with its whole correction since it
    /// became passive.
    fn turn_errors(
        &mut self,
        moved: &DVector<f64>,
        numbers: &[(usize, usize)],
        active: &Active,
        rows: &mut DMatrix<f64>,
    ) {
        let Some(heading) = numbers.iter().position(|(at, _)| *at == HEADING) else { return };
        let mut d = DVector::zeros(moved.len());
        // Robots are always active, so passive variables are landmarks, two indices each.
        for store in self.landmarks.iter().filter(|s| !numbers.iter().any(|(_, n)| n == *s)) {
            (d[*store], d[store + 1]) = (-moved[store + 1], moved[*store]);
        }
        let own = rows.column(heading).into_owned();
        let variance = active.covariance.at(HEADING, HEADING);
        for (k, (at, _)) in numbers.iter().enumerate() {
            rows.column_mut(k).axpy(active.covariance.at(HEADING, *at), &d, 1.0);
        }
        let right = DMatrix::from_columns(&[own.clone(), d.clone()]);
        let left = -DMatrix::from_columns(&[d.clone(), own + d * variance]);
        self.covariance.subtract(left, right);
    }

    /// Makes these variables the active ones, in this order; returns their places.
    pub fn open(&mut self, active: &mut Active, form: Form, members: &[(usize, usize)]) -> Vec<Place> {
        let mut places = Vec::with_capacity(members.len());
        let mut numbers = Vec::new();
        for &(store, size) in members {
            places.push(Place { at: numbers.len(), size });
            numbers.extend(store..store + size);
        }
        let n = numbers.len();
        self.cross = self.covariance.rows(&numbers, self.x.len());
        let mut matrix = Vec::with_capacity(n * n);
        for column in 0..n {
            matrix.extend(numbers.iter().map(|row| self.cross[(*row, column)]));
        }
        active.covariance = Covariance::from_matrix(form, n, matrix);
        active.x = numbers.iter().map(|k| self.x[*k]).collect();
        active.angles = places.iter().flat_map(|p| (0..p.size).map(|k| k == 2)).collect();
        active.first = numbers.iter().map(|k| self.first[*k]).collect();
        active.deferred = Some(Deferred::new(n));
        places
    }

    /// Does a part of the postponed subtractions.
    pub fn settle(&mut self) {
        self.covariance.settle(self.covariance.backlog().div_ceil(SPREAD));
    }

    /// Present estimate and covariance of a passive landmark.
    pub fn landmark(&self, active: &Active, store: usize) -> (Vector2<f64>, Matrix2<f64>) {
        let mut value = Vector2::new(self.x[store], self.x[store + 1]);
        let mut covariance = Matrix2::from_fn(|i, j| self.covariance.at(store + i, store + j));
        if let Some(deferred) = active.deferred.as_ref().filter(|_| store + 1 < self.cross.nrows()) {
            let rows = self.cross.rows(store, 2);
            value += rows * &deferred.theta;
            covariance -= rows * &deferred.psi * rows.transpose();
        }
        (value, covariance)
    }
}
