#![doc = include_str!("../README.md")]

mod decide;
mod imu;
mod local_map;
mod lost;
mod match_last;
mod recover;
mod rotation;
mod scale;
mod start;
mod state;
mod static_landmarks;
mod tracker;

pub use state::{AnchoredPose, Evidence, KeyFrameRequest, RelocationPrior, State, Tracked};
pub use tracker::{Tracker, TrackerConfig};
