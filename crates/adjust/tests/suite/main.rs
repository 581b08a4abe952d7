//! The integration tests of this crate, as one program.

mod aligned;
#[path = "common/imu_walk.rs"]
#[allow(dead_code)]
mod imu_walk;
mod inertial;
mod motion;
mod places;
#[path = "common/mod.rs"]
mod synthetic;
mod windows;
