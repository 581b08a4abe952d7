#![doc = include_str!("../README.md")]

mod clocks;
mod closing;
mod cull;
mod disparity;
mod fuse;
mod grow;
mod inertial;
mod insert;
mod mapper;
mod turning;

pub use closing::{Accepted, Closed, Closer, CloserConfig, Joined, Refusal, Verdict};
pub use inertial::InertialConfig;
pub use mapper::{Begin, Mapped, Mapper, MapperConfig, Submitted};
