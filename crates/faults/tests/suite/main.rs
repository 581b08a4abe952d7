//! Walks in which everything may fail.

mod walks;
