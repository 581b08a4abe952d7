//! The passive part of the map, far from the robot, and the updates to apply to it when the robot returns.
//!
//! Source: Guivant and Nebot (2001), equations of the compressed filter. While a region is active its covariance `P_AA`
//! is updated as usual; for the rest only three small matrices are kept: `phi`, the transition of the errors that were
//! active at the start, `psi`, the information gained about them, and `theta`, the resulting correction of the state.
//! With `W = P_BA` at the start: `P_AB = phi W^T`, `P_BB -= W psi W^T`, `x_B += W theta`. They grow with the region,
//! not with the map.
//!
//! Corrections of the invariant filter change the covariance of all plain errors. Its own errors change by the noise of the
//! heading instead, in a way that three matrices hold as well (`deferred.rs`), so they are what is stored, and local updates
//! are exact for it too.

use super::active::{Active, Place};
use super::deferred::{Deferred, HEADING};
use super::tiles::Tiles;
use crate::covariance::Covariance;
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
    /// Rows of the active region against everything, as they were when it became active: `W`, in the columns of `deferred.rs`.
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
        if active.is_invariant() {
            active.turn_errors(-1.0);
        }
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

    /// Makes these variables the active ones, in this order; returns their places.
    pub fn open(&mut self, active: &mut Active, members: &[(usize, usize)]) -> Vec<Place> {
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
        active.covariance = Covariance::from_matrix(n, matrix);
        active.x = numbers.iter().map(|k| self.x[*k]).collect();
        active.angles = places.iter().flat_map(|p| (0..p.size).map(|k| k == 2)).collect();
        active.first = numbers.iter().map(|k| self.first[*k]).collect();
        active.deferred = Some(Deferred::new(n, active.is_invariant()));
        if active.is_invariant() {
            active.turn_errors(1.0);
            self.pair_columns();
        }
        places
    }

    /// Brings `W` into the columns of the invariant filter. Robots are always active, so only rows of landmarks count.
    fn pair_columns(&mut self) {
        let (n, width) = self.cross.shape();
        let mut paired = DMatrix::zeros(n, 2 * width + 2);
        for &store in &self.landmarks {
            let cross = (0..width).map(|c| (self.cross[(store, c)], self.cross[(store + 1, c)]));
            let rows = Deferred::columns(self.x[store], self.x[store + 1], cross);
            for (k, row) in rows.iter().enumerate() {
                paired.row_mut(store + k).iter_mut().zip(row).for_each(|(to, from)| *to = *from);
            }
        }
        self.cross = paired;
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
            let rows = self.cross.fixed_rows::<2>(store);
            value += rows * &deferred.theta;
            covariance -= rows * &deferred.psi * rows.transpose();
            if active.is_invariant() {
                let by_heading: Vector2<f64> = rows * DVector::from_column_slice(&deferred.phi[HEADING]);
                let across = Vector2::new(-value.y, value.x);
                let both = across * by_heading.transpose();
                let variance = active.covariance.at(HEADING, HEADING);
                covariance += both + both.transpose() + across * across.transpose() * variance;
            }
        }
        (value, covariance)
    }
}
