//! A phone as phones are: a lens that nobody measured, a rolling shutter, motion sensors at 60 Hz with jitter that start
//! late, noise and biases of their own, a camera that is not where the sensors are.
//!
//! The caller moves the phone step by step; pictures and readings are taken from the smooth motion through these steps,
//! two of them behind.

mod senses;
mod shutter;
mod traits;

pub use senses::MotionSensors;
pub use shutter::RollingCamera;
pub use traits::PhoneTraits;

use crate::walk::ContinuousTrajectory;
use cairn_geometry::Se3;

/// Steps by which the settled motion is behind the last one given.
const BEHIND: usize = 2;

/// The motion of a phone that is moved step by step by the caller.
#[derive(Clone, Debug)]
pub struct PhoneMotion {
    dt: f64,
    motion: ContinuousTrajectory,
    given: usize,
}

impl PhoneMotion {
    /// At rest at a pose of the camera in the world, at time 0; a step is `dt` seconds.
    pub fn new(dt: f64, world_from_camera: &Se3) -> Self {
        Self { dt, motion: ContinuousTrajectory::sampled(0.0, dt, &[*world_from_camera]), given: 1 }
    }

    /// The camera's next pose, one step after the one before.
    pub fn step(&mut self, world_from_camera: &Se3) {
        self.motion.extend(world_from_camera);
        self.given += 1;
    }

    /// Seconds of the last pose given.
    pub fn end_s(&self) -> f64 {
        self.motion.end()
    }

    /// Seconds up to which nothing changes any more.
    pub fn settled_s(&self) -> f64 {
        self.dt * self.given.saturating_sub(1 + BEHIND) as f64
    }

    /// The motion itself.
    pub fn motion(&self) -> &ContinuousTrajectory {
        &self.motion
    }
}
