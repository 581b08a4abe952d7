//! The integration tests of this crate, as one program.

mod bags;
mod camera;
mod common;
mod elsewhere;
mod recordings;
mod refusals;
mod rigs;
mod simulated;
mod video;
