#![doc = include_str!("../README.md")]

pub mod anchored;
pub mod band;
pub mod control;
pub mod costmap;
pub mod depth_scan;
pub mod distance;
pub mod frontier;
pub mod give_way;
pub mod grid;
pub mod ground;
pub mod map_server;
pub mod moving_ai;
pub mod occupancy;
mod passable;
pub mod picture;
pub mod route;
pub mod search;
pub mod smooth;
pub mod sparse;
pub mod walked;

pub use costmap::{CostConfig, Costmap};
pub use distance::DistanceField;
pub use grid::{Cell, Grid, GridError, GridFrame};
pub use occupancy::{OccupancyConfig, OccupancyGrid};
pub use passable::Passable;
