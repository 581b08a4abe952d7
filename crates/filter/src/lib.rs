#![doc = include_str!("../README.md")]
//!
//! Everything is in the plane: poses are `world_from_body` as x, y in metres and an angle in radians, counter-clockwise.

pub mod angle;
pub mod batch;
pub mod calibrate;
pub mod chi2;
mod covariance;
pub mod ekf;
pub mod frame;
pub mod joint;
pub mod log;
pub mod measure;
pub mod motion;
pub mod page;
pub mod run;
pub mod simulate;
pub mod truth;
