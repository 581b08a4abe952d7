//! What a walker needs from occupancy: columns, what is in the way. All of it is plain data, computed
//! anew for a window around a place, from any occupancy (that of a submap, or of a whole map).
//!
//! The window's frame is level: z up, its origin chosen by the caller (for example at the walker's feet).

mod around;
mod columns;
mod floor;
mod local;
mod tiles;

pub use around::free_around;
pub use columns::{Columns, Span, Window};
pub use local::{Blocked, Hit, LocalConfig, LocalSpace, first_hit};
pub use tiles::{ColumnAxes, ColumnTile, TILE};
