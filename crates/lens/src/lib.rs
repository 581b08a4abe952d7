#![doc = include_str!("../README.md")]

mod gyro;
mod joint;
mod model;
mod problem;
mod solve;
mod turns;

pub use gyro::GyroLink;
pub use model::Lens;
pub use problem::LensProblem;
pub use solve::LensEstimate;
pub use turns::TurnFactor;
