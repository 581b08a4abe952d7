#![doc = include_str!("../README.md")]
#![cfg(feature = "dds")]

pub mod assemble;
pub mod faults;
pub mod frames;
pub mod grid;
pub mod markers;
pub mod messages;
pub mod network;
pub mod node;
pub mod options;
pub mod pictures;
pub mod planner;
pub mod results;
pub mod setup;
pub mod time;
pub mod worker;
