//! Shared by the tests: a simulated scene of textured planes with exact ground truth, and readers of recordings.
#![allow(dead_code)]

pub mod recordings;
pub mod scene;
