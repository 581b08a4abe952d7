//! The integration tests of this crate, as one program.

mod common;
mod export;
mod local;
mod occupancy;
mod photometric;
mod register;
mod scene;
mod track;
mod tsdf;
mod walk;
