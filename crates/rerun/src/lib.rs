#![doc = include_str!("../README.md")]

mod address;
mod message;
mod wire;

pub use address::viewer;
pub use message::{Colour, Level, Message, Pose, Show};
pub use wire::{VERSION, WireError, read, write};
