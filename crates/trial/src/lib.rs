#![doc = include_str!("../README.md")]

mod listener;
pub mod robot;
pub mod walk;
mod walker;
pub mod way;

pub use walker::{Walker, side_of};
