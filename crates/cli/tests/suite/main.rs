//! The integration tests of this crate, as one program.

mod binary;
mod docs;
mod serve;
mod serve_dense;
