#![doc = include_str!("../README.md")]

mod link;
mod member;
mod send_limit;
mod wire;

pub use member::Member;
pub use wire::{Event, LinkId, Wire};
