//! Poses whose frames are part of the type, for public walls.

use crate::Se3;
use std::marker::PhantomData;

/// The corrected map frame: loop closures move poses in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum World {}
/// The smooth frame: poses in it never jump; guidance uses it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Odom {}
/// The rig's body frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Body {}
/// A camera's optical frame: x right, y down, z forward.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Camera {}

/// A rigid transform `To_from_From` that the compiler will not let pass for another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose<To, From> {
    /// The transform itself.
    pub se3: Se3,
    frames: PhantomData<(To, From)>,
}

impl<To, From> Pose<To, From> {
    /// States which frames a transform joins.
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
