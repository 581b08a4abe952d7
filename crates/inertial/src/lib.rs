#![doc = include_str!("../README.md")]

mod buffer;
mod factor;
mod health;
mod initialise;
mod innovation;
mod nav_estimate;
mod noise;
mod offset;
mod preintegrated;
mod readings;
mod rest;
mod state;
mod tracks;
mod window;

pub use buffer::{ImuBuffer, Missing};
pub use factor::InertialResidual;
pub use health::{Failed, ImuFault, ReadingsCheck};
pub use initialise::{
    Attempt, Gate, GateKind, Initial, InitialiseConfig, Scale, Seen, SeenPose, initialise,
    initialise_in_slices,
};
pub use innovation::{Difference, Innovation, Known, innovation};
pub use nav_estimate::{Level, NavEstimate};
pub use noise::of_data_sheet;
pub use offset::{OffsetConfig, OffsetUnknown, TimeOffset, time_offset};
pub use preintegrated::Preintegrated;
pub use readings::{Doubt, Readings};
pub use rest::{Moves, Rest, RestConfig};
pub use state::{Bias, Gravity, NavState};
pub use tracks::{TrackMotion, TrackPoint, TrackPriors, Tracks, motion_of_tracks};
pub use window::{BiasPrior, ImuFactors, ImuLink, LeverArm, MotionFreedom, SpeedAndBias, ZeroVelocity};
