//! The integration tests of this crate, as one program.

mod journal;
mod pixels;
mod ring;
