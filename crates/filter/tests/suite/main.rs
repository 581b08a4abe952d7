//! The integration tests of this crate, as one program.

mod logs;
mod simulated;
