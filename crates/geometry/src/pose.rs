//! Poses whose frames are part of the type, for public interfaces.

use crate::Se3;
use std::marker::PhantomData;

/// The map frame (REP 105 `map`): corrected by loop closures, so poses in it can jump.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum World {}
/// The odometry frame (REP 105 `odom`): poses in it never jump; used for guidance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Odom {}
/// The rig's body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {}
/// A camera's optical frame: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Camera {}

/// A rigid transform `To_from_From`; the compiler checks that its frames match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<To, From> {
    /// The transform itself.
    pub se3: Se3,
    frames: PhantomData<(To, From)>,
}

impl<To, From> Pose<To, From> {
    /// Assigns the frames to a transform.
    pub fn new(se3: Se3) -> Self {
        Self { se3, frames: PhantomData }
    }

    /// The inverse pose.
    pub fn inverse(&self) -> Pose<From, To> {
        Pose::new(self.se3.inverse())
    }

    /// Composes `To_from_From * From_from_C`.
    pub fn then<C>(&self, next: &Pose<From, C>) -> Pose<To, C> {
        Pose::new(self.se3 * next.se3)
    }
}
