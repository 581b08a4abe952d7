//! Writes any source as a folder in a well-known layout, whole or not at all.

mod euroc;
mod folder;
mod tum;

pub use euroc::write_euroc;
pub use tum::write_tum;
