//! Each rule of the guide, on scripted poses.

mod corrections;
mod directions;
mod path;
mod stops;
mod walker;
