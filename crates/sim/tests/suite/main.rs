//! The integration tests of this crate, as one program.

mod effects;
mod geometry;
mod smooth;
mod source;
mod write;
