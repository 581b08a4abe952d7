//! Poses whose frames are part of the type, for public interfaces.

use crate::{Se3, Sim3};
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

/// A similarity `To_from_From`, for two frames whose units of length differ; the compiler checks that its frames match.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Similarity<To, From> {
    /// The transform itself; its scale is the length of a unit of `From` in units of `To`.
    pub sim3: Sim3,
    frames: PhantomData<(To, From)>,
}

impl<To, From> Similarity<To, From> {
    /// Assigns the frames to a transform.
    pub fn new(sim3: Sim3) -> Self {
        Self { sim3, frames: PhantomData }
    }

    /// The similarity that takes `from_from_c` to `to_from_c`, with this scale.
    pub fn between<C>(to_from_c: &Pose<To, C>, from_from_c: &Pose<From, C>, scale: f64) -> Self {
        let rotation = to_from_c.se3.rotation * from_from_c.se3.rotation.inverse();
        let translation = to_from_c.se3.translation - rotation * from_from_c.se3.translation * scale;
        Self::new(Sim3::new(rotation, translation, scale))
    }

    /// The inverse similarity.
    pub fn inverse(&self) -> Similarity<From, To> {
        Similarity::new(self.sim3.inverse())
    }

    /// Composes `To_from_From * From_from_C`; lengths are scaled, the rotation remains a rotation.
    pub fn then<C>(&self, next: &Pose<From, C>) -> Pose<To, C> {
        Pose::new(self.sim3.transform_pose(&next.se3))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{So3, Vec3};

    #[test]
    fn a_similarity_between_two_poses_takes_one_to_the_other() {
        let world: Pose<World, Body> =
            Pose::new(Se3::new(So3::exp(&Vec3::new(0.3, -0.2, 1.1)), Vec3::new(4.0, -1.0, 0.5)));
        let odom: Pose<Odom, Body> =
            Pose::new(Se3::new(So3::exp(&Vec3::new(-0.1, 0.4, 0.2)), Vec3::new(-2.0, 3.0, 1.5)));
        let world_from_odom = Similarity::between(&world, &odom, 2.5);
        assert_eq!(world_from_odom.sim3.scale, 2.5);
        let near = |a: &Se3, b: &Se3| (a.inverse() * *b).log().norm() < 1e-12;
        assert!(near(&world_from_odom.then(&odom).se3, &world.se3));
        assert!(near(&world_from_odom.inverse().then(&world).se3, &odom.se3));
    }
}
