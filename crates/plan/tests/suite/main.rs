//! The integration tests of this crate, as one program.

mod control;
mod maps;
mod search;
