//! The integration tests of this crate, as one program.

#[path = "common/imu_walk.rs"]
#[allow(dead_code)]
mod imu_walk;
mod inertial;
mod motion;
mod places;
mod relative_pose;
#[path = "common/mod.rs"]
mod synthetic;
mod windows;
