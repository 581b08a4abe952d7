#![doc = include_str!("../README.md")]

mod decide;
mod inertia;
mod local_map;
mod lost;
mod match_last;
mod proven;
mod recover;
mod start;
mod state;
mod tracker;

pub use state::{Adrift, Evidence, Offer, Placed, State, Tracked};
pub use tracker::{Tracker, TrackerSetting};
