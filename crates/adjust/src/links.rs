//! What relates key frames of a window beside landmarks: measured motions, and relative poses by depth; with IMU factors or without.

use crate::aligned::AlignedFactors;
use crate::motion::MotionFactors;
use cairn_geometry::Se3;
use cairn_solve::{Equations, Factors, Freedom, Variable};
use std::ops::Range;

/// Factors of both kinds.
#[derive(Clone, Debug, Default)]
pub(crate) struct LinkFactors {
    pub motion: MotionFactors,
    pub aligned: AlignedFactors,
}

impl LinkFactors {
    /// Without those that touch only poses that do not move.
    pub fn keep_free(&mut self, freedom: &[Freedom]) {
        self.motion.keep_free(freedom);
        self.aligned.keep_free(freedom);
    }

    pub fn is_empty(&self) -> bool {
        self.motion.is_empty() && self.aligned.is_empty()
    }

    /// As factors of one bundle.
    pub fn all(&mut self) -> Both<'_, MotionFactors, AlignedFactors> {
        Both(&mut self.motion, &mut self.aligned)
    }
}

/// Factors of two kinds, of which only the first may have variables of its own.
pub(crate) struct Both<'a, A, B>(pub &'a mut A, pub &'a mut B);

impl<A: Factors, B: Factors> Factors for Both<'_, A, B> {
    fn sizes(&self) -> Vec<usize> {
        debug_assert!(self.1.sizes().is_empty());
        self.0.sizes()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        self.0.held()
    }
    fn is_empty(&self) -> bool {
        self.0.is_empty() && self.1.is_empty()
    }
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.0.scopes(visit);
        self.1.scopes(visit);
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        self.0.linearise(poses, equations)?;
        self.1.linearise(poses, equations)
    }
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        self.0.attempt(poses, step) + self.1.attempt(poses, step)
    }
    fn accept(&mut self) {
        self.0.accept();
        self.1.accept();
    }
}
