#![doc = include_str!("../README.md")]

pub mod distance;
pub mod grid;
pub mod map_server;
pub mod moving_ai;
mod passable;
pub mod picture;
pub mod random;
pub mod search;

pub use distance::DistanceField;
pub use grid::{Cell, Grid, GridError, GridFrame};
pub use passable::Passable;
