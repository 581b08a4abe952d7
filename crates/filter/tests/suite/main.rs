//! The integration tests of this crate, as one program.

mod drawn;
mod logs;
mod simulated;
mod textbook;
mod truth;
