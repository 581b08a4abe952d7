//! What a walker needs of occupancy: columns, ground, costs, hazards, distances. All of it is plain data made anew for a window
//! around a place, from any occupancy (a submap's, or a whole map's).
//!
//! The window's frame is level: z up, origin where the caller puts it (say, at the walker's feet).

mod columns;
mod distance;
mod ground;
mod hazard;

pub use columns::{Columns, Span, Window};
pub use distance::distance_field;
pub use ground::{Cell, Ground, GroundConfig, Surface};
pub use hazard::{Hazard, HazardConfig, HazardKind, hazards};
