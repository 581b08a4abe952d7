//! The integration tests of this crate, as one program.

mod common;
mod files;
mod messages;
