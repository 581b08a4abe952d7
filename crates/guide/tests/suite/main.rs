//! The integration tests of this crate, as one program.

mod clean;
mod facing;
mod real_routes;
mod rules;
