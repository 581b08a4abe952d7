//! How a body moves through a world: smooth motions, walkers, inertial readings.

mod imu;
mod motion;
mod stride;
mod trajectory;
mod walker;

pub use imu::{GRAVITY_M_S2, ImuSetting};
pub use motion::{BodyState, Motion};
pub use stride::Stride;
pub use trajectory::read_tum;
pub use walker::Walker;

pub(crate) use imu::ImuSim;
