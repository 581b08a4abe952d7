//! The motion of a body through a world: smooth motions, walkers, IMU readings.

mod imu;
mod motion;
mod readings;
mod recorded;
mod stride;
mod trajectory;
mod troubles;
mod walker;

pub use imu::ImuConfig;
pub use motion::{BodyState, ContinuousTrajectory};
pub use readings::read_readings;
pub use recorded::Agreement;
pub use stride::Stride;
pub use trajectory::read_tum;
pub use troubles::ImuTroubles;
pub use walker::Walker;

pub(crate) use imu::ImuSim;
pub(crate) use recorded::Recorded;
pub(crate) use troubles::Troubled;
