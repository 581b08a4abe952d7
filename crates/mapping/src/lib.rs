#![doc = include_str!("../README.md")]

mod clocks;
mod closing;
mod cull;
mod disparity;
mod fuse;
mod inertial;
mod insert;
mod mapper;
mod rotation_only;
mod scale_check;
#[cfg(test)]
#[path = "../../adjust/tests/common/mod.rs"]
mod synthetic;
#[cfg(test)]
mod tests;
mod triangulation;

pub use closing::{Accepted, Closed, Closer, CloserConfig, Joined, Refusal, Verdict};
pub use inertial::InertialConfig;
pub use mapper::{MapStart, Mapped, Mapper, MapperConfig, Submitted};
pub use scale_check::{ScaleCheck, ScaleVerdict};
