#![doc = include_str!("../README.md")]

mod camera;
mod excerpt;
mod inertial;
mod locate;
mod recognise;
mod window;

pub use camera::{depth, pinhole, pixel, weight};
pub use inertial::{Feeling, InertialWindow};
pub use locate::{Located, locate};
pub use recognise::{RecogniseSetting, Recognised, Unlike, recognise};
pub use window::{Settled, Window, WindowSetting};
