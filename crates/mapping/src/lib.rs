#![doc = include_str!("../README.md")]

mod close;
mod cull;
mod fuse;
mod grow;
mod insert;
mod mapper;

pub use mapper::{Begin, Mapped, Mapper, MapperSetting};
