//! `--rerun`: the run as a recording of the rerun viewer; docs/rerun.md describes the file.

mod pipe;
mod scene;
mod shown;

pub use scene::Scene;
