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

pub use closing::{Accepted, Closed, Closer, CloserSetting, Joined, Refusal, Verdict};
pub use inertial::InertialSetting;
pub use mapper::{Begin, Mapped, Mapper, MapperSetting, Offered};
