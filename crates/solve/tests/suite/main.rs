//! The integration tests of this crate, as one program.

mod bal;
mod certify;
mod condense;
mod g2o;
mod graphs;
