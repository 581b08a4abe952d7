//! The integration tests of this crate, as one program.

mod common;
mod initialise;
mod offset;
mod preintegrated;
mod window;
