//! What the tests share: a small world of textured planes with exact truth, and readers of recordings.
#![allow(dead_code)]

pub mod recordings;
pub mod scene;
