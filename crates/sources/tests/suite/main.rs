//! The integration tests of this crate, as one program.

mod bags;
mod camera;
mod common;
mod conventions;
mod elsewhere;
mod layouts;
mod other_systems;
mod recordings;
mod refusals;
mod rigs;
mod simulated;
mod video;
mod witnesses;
mod written;
