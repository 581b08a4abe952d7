//! What relates key frames of a window beside landmarks: measured motions, and relative poses by depth.

use crate::aligned::AlignedFactors;
use crate::motion::MotionFactors;
use cairn_geometry::Se3;
use cairn_solve::{Equations, Factors, Freedom, Variable};
use std::ops::Range;

/// Factors of both kinds; neither has variables of its own.
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
}

impl Factors for LinkFactors {
    fn sizes(&self) -> Vec<usize> {
        Vec::new()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        Vec::new()
    }
    fn is_empty(&self) -> bool {
        self.motion.is_empty() && self.aligned.is_empty()
    }
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.motion.scopes(visit);
        self.aligned.scopes(visit);
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        self.motion.linearise(poses, equations)?;
        self.aligned.linearise(poses, equations)
    }
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        self.motion.attempt(poses, step) + self.aligned.attempt(poses, step)
    }
    fn accept(&mut self) {
        self.motion.accept();
        self.aligned.accept();
    }
}
