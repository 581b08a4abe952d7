//! Writing MCAP (mcap.dev/spec), and messages of Foxglove's schemas in ROS 2 form.

mod cdr;
pub mod foxglove;
mod mcap;

pub use mcap::{Channel, McapWriter};
