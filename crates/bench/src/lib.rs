#![doc = include_str!("../README.md")]

pub mod accuracy;
pub mod build;
pub mod busy;
pub mod city;
mod darkened;
pub mod dense;
pub mod depth_scale;
mod error;
pub mod figures;
pub mod graphs;
pub mod halves;
pub mod imu_faults;
pub mod inertial;
#[cfg(unix)]
pub mod kills;
pub mod live;
pub mod long;
pub mod measure;
pub mod memory;
pub mod nextday;
pub mod pages;
pub mod phone;
pub mod places;
pub mod processor;
pub mod recordings;
pub mod revisit;
mod run;
pub mod scale_sigma;
pub mod store;
pub mod street;
pub mod visual_inertial;
pub mod walks;

pub use cairn_engine::Sensors;
pub use error::MeasureError;
pub use measure::{Measured, RunOptions, measure};
