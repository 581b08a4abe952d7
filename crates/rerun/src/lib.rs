#![doc = include_str!("../README.md")]

mod message;
mod wire;

pub use message::{Colour, Level, Message, Pose, Show};
pub use wire::{VERSION, WireError, read, write};
