#![doc = include_str!("../README.md")]

mod link;
mod member;
mod wire;

pub use member::Member;
pub use wire::{Event, LinkId, Wire};
