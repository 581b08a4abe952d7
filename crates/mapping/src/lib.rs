#![doc = include_str!("../README.md")]

mod cull;
mod fuse;
mod grow;
mod insert;
mod mapper;

pub use mapper::{Mapped, Mapper, MapperSetting};
