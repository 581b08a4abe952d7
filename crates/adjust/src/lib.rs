#![doc = include_str!("../README.md")]

mod aligned;
mod camera;
mod imu;
mod links;
mod locate;
mod motion;
mod parallax;
mod recognise;
mod subproblem;
mod window;

pub use camera::{depth, pinhole, pixel, weight};
pub use imu::ImuModel;
pub use locate::{Located, locate};
pub use motion::{MotionLinks, MotionSince};
pub use parallax::has_parallax;
pub use recognise::{MatchFailure, RecogniseConfig, Recognised, View, recognise};
pub use window::{Window, WindowConfig, WindowResult};
