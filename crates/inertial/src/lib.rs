#![doc = include_str!("../README.md")]

mod buffer;
mod factor;
mod preintegrated;
mod state;

pub use buffer::{ImuBuffer, Missing};
pub use factor::InertialResidual;
pub use preintegrated::Preintegrated;
pub use state::{Bias, GRAVITY_M_S2, Gravity, NavState};
