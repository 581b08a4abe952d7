#![doc = include_str!("../README.md")]

mod camera;
mod inertial;
mod locate;
mod recognise;
mod subproblem;
mod window;

pub use camera::{depth, pinhole, pixel, weight};
pub use inertial::{ImuModel, InertialWindow};
pub use locate::{Located, locate};
pub use recognise::{MatchFailure, RecogniseConfig, Recognised, recognise};
pub use window::{Window, WindowConfig, WindowResult};
