//! The integration tests of this crate, as one program.

mod cleaning;
mod languages;
mod robot;
mod walks;
