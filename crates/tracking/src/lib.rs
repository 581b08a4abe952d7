#![doc = include_str!("../README.md")]

mod clock;
mod config;
mod decide;
#[cfg(test)]
mod decide_tests;
mod dense;
#[cfg(test)]
mod dense_tests;
mod first_clocks;
mod first_lens;
mod flow;
mod hint;
#[cfg(test)]
mod hint_tests;
mod imu;
#[cfg(test)]
mod imu_tests;
mod imu_trust;
#[cfg(test)]
mod imu_trust_tests;
mod local_map;
mod match_last;
mod mode;
mod odometry;
#[cfg(test)]
mod odometry_tests;
mod on_the_spot;
#[cfg(test)]
mod one_camera_tests;
mod parallax;
mod priors;
mod reckoned;
#[cfg(test)]
mod reckoning_tests;
mod recover;
mod rotation;
mod scale;
mod setup;
mod shutter;
#[cfg(test)]
mod shutter_tests;
mod start;
#[cfg(test)]
mod start_tests;
mod state;
#[cfg(test)]
mod step_tests;
#[cfg(test)]
#[path = "../../adjust/tests/suite/common/mod.rs"]
mod synthetic;
#[cfg(test)]
mod tests;
mod tracker;

pub use config::TrackerConfig;
pub use first_lens::{FirstLens, first_lens};
pub use flow::FlowClocks;
pub use hint::{HintOutcome, PlaceHint};
pub use odometry::{MotionSource, Odometry};
pub use priors::MeasuredMotion;
pub use state::{AnchoredPose, Evidence, KeyFrameRequest, RelocationPrior, State, Tracked};
pub use tracker::{DepthPlaced, FoundByDepth, Tracker};
