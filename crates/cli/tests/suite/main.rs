//! The integration tests of this crate, as one program.

mod binary;
mod docs;
mod serve;
mod serve_dense;
#[cfg(unix)]
#[path = "../../../web/tests/suite/walked/mod.rs"]
mod walked;
