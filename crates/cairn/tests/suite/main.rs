//! The integration tests of this crate, as one program.

mod camera;
mod corner_size;
mod examples;
mod merge;
mod mixed;
mod recordings;
mod refusals;
mod registration;
mod team;
mod team_atlas;
mod team_graph;
