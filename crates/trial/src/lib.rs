#![doc = include_str!("../README.md")]

#[cfg(target_arch = "wasm32")]
mod exports;
mod listener;
mod pace;
mod page;
mod picture;
pub mod robot;
pub mod walk;
mod walker;
pub mod way;

pub use pace::{LEVELS, Pace};
pub use page::{Lateness, PageClock, STALE_MS};
pub use picture::{encoded, smaller};
pub use walker::{Walker, direction_of, side_of};
