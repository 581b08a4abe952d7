//! Sparse Cholesky factorisation of symmetric positive definite matrices made of blocks.
//!
//! The pattern is analysed once ([`Analysis`]: ordering, elimination tree, supernodes, where each block goes); numbers are
//! factored as often as they change ([`Factor`]). Everything is sequential and in a fixed order: the same bits every time.

mod dense;
mod factor;
mod fused;
mod order;
mod symbolic;

pub use factor::{Blocks, Factor, NotPositive, UniformBlocks};
pub use symbolic::Analysis;
