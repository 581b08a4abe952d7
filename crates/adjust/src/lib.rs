#![doc = include_str!("../README.md")]

mod aligned;
mod calibration;
mod camera;
mod corner;
mod factor;
mod imu;
mod level;
mod locate;
mod motion;
mod parallax;
mod recognise;
mod subproblem;
mod window;

pub use aligned::RelativePoseFactors;
pub use camera::{depth, pinhole, pixel, weight};
pub use factor::{Chain, Frames, Judgement, WindowFactors};
pub use imu::{Imu, ImuModel};
pub use level::Level;
pub use locate::{Located, locate};
pub use motion::{MotionFactors, MotionLinks, MotionSince};
pub use parallax::has_parallax;
pub use recognise::{MatchFailure, RecogniseConfig, Recognised, View, recognise};
pub use window::{Window, WindowBuilder, WindowConfig, WindowResult};
