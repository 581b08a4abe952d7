//! What relates key frames of a window beside landmarks: measured motions, and relative poses by depth; with IMU factors or without.

use crate::aligned::AlignedFactors;
use crate::motion::MotionFactors;
use cairn_geometry::Se3;
use cairn_inertial::ImuFactors;
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

/// IMU factors, which alone have variables of their own, and links.
pub(crate) struct WithImu<'a> {
    pub imu: &'a mut ImuFactors,
    pub links: &'a mut LinkFactors,
}

impl Factors for WithImu<'_> {
    fn sizes(&self) -> Vec<usize> {
        self.imu.sizes()
    }
    fn held(&self) -> Vec<(usize, Range<usize>)> {
        self.imu.held()
    }
    fn is_empty(&self) -> bool {
        self.imu.is_empty() && self.links.is_empty()
    }
    fn scopes(&self, visit: &mut dyn FnMut(&[Variable])) {
        self.imu.scopes(visit);
        self.links.scopes(visit);
    }
    fn linearise(&mut self, poses: &[Se3], equations: &mut Equations) -> Option<()> {
        self.imu.linearise(poses, equations)?;
        self.links.linearise(poses, equations)
    }
    fn attempt(&mut self, poses: &[Se3], step: &[f64]) -> f64 {
        self.imu.attempt(poses, step) + self.links.attempt(poses, step)
    }
    fn accept(&mut self) {
        self.imu.accept();
        self.links.accept();
    }
}
