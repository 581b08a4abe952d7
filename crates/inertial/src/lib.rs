#![doc = include_str!("../README.md")]

mod belief;
mod buffer;
mod factor;
mod initialise;
mod offset;
mod preintegrated;
mod readings;
mod rest;
mod state;
mod window;

pub use belief::Belief;
pub use buffer::{ImuBuffer, Missing};
pub use factor::InertialResidual;
pub use initialise::{
    Attempt, Gate, GateKind, Initial, InitialiseSetting, Scale, Seen, SeenPose, initialise,
};
pub use offset::{OffsetSetting, OffsetUnknown, TimeOffset, time_offset};
pub use preintegrated::Preintegrated;
pub use readings::{Doubt, Readings};
pub use rest::{Moves, Rest, RestSetting};
pub use state::{Bias, GRAVITY_M_S2, Gravity, NavState};
pub use window::{BiasPrior, Hold, VioFrame, VioLink, VioSetting, VioWindow};
