//! Factors and variables that a bundle is solved with beside its observations: IMU factors with velocities and biases,
//! say. They supply residuals and Jacobians; the one solver does the rest.

use crate::schur::Normal;
use cairn_geometry::Se3;
use nalgebra::{SMatrix, SVector};
use std::ops::Range;

/// A variable that a factor touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Variable {
    /// A pose of the bundle, by its index: translation and rotation, perturbed on the right.
    Pose(usize),
    /// A free variable of the factors' own, by its place among [`Factors::sizes`].
    Own(usize),
}

/// Factors over the poses of a bundle and variables of their own.
pub trait Factors {
    /// Unknowns of each free variable of their own.
    fn sizes(&self) -> Vec<usize>;
    /// Components of own variables that stay as they are.
    fn held(&self) -> Vec<(usize, Range<usize>)>;
    /// True when there is no factor.
    fn is_empty(&self) -> bool;
    /// Calls `visit` with the variables of each factor.
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable]));
    /// Adds every factor at the current state to the equations; `None` when one of them cannot be linearised.
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()>;
    /// Moves the own variables by a step (all of them, one after the other) into a trial state; returns the cost of all
    /// factors there.
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64;
    /// Makes the trial state the current one.
    fn accept(&mut self);
}

/// No factors.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoFactors;

impl Factors for NoFactors {
    fn sizes(&self) -> Vec<usize> {
        Vec::new()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        Vec::new()
    }
    fn is_empty(&self) -> bool {
        true
    }
    fn scopes(&self, _: &mut dyn FnMut(&[Variable])) {}
    fn linearise(&mut self, _: &[Se3], _: &mut Equations) -> Option<()> {
        Some(())
    }
    fn attempt(&mut self, _: &[Se3], _: &[f64]) -> f64 {
        0.0
    }
    fn accept(&mut self) {}
}

/// The normal equations that factors add themselves to.
pub struct Equations<'a> {
    normal: &'a mut Normal<6>,
    /// Block row of each pose, when it is free.
    slot: &'a [Option<u32>],
}

impl<'a> Equations<'a> {
    pub(crate) fn new(normal: &'a mut Normal<6>, slot: &'a [Option<u32>]) -> Self {
        Self { normal, slot }
    }

    /// Adds a factor: its whitened residual, the Jacobian, and for each variable which columns of it are its. Variables
    /// that are not free are `None` or fixed poses. Its variables were visited by [`Factors::scopes`].
    pub fn add<const R: usize, const C: usize>(
        &mut self,
        residual: &SVector<f64, R>,
        jacobian: &SMatrix<f64, R, C>,
        parts: &[(Option<Variable>, Range<usize>)],
    ) {
        let free = self.normal.cameras.len();
        let row = |v: Option<Variable>| match v? {
            Variable::Pose(i) => self.slot.get(i).copied().flatten().map(|s| s as usize),
            Variable::Own(i) => Some(free + i),
        };
        let parts: Vec<_> = parts.iter().map(|(v, columns)| (row(*v), columns.clone())).collect();
        self.normal.add_factor(residual, jacobian, &parts);
    }
}
