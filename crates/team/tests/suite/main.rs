//! The integration tests of this crate, as one program.

mod argos;
mod features;
mod messages;
mod peers;
mod rejection;
mod words;
