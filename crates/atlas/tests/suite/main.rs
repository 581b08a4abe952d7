//! The integration tests of this crate, as one program.

mod histories;
mod places;
mod store;
