#![doc = include_str!("../README.md")]

mod camera;
mod locate;
mod window;

pub use camera::{depth, pinhole, pixel, weight};
pub use locate::{Located, locate};
pub use window::{Settled, Window, WindowSetting};
