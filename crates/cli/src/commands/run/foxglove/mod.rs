//! `--mcap`, `--foxglove`: the run with Foxglove's schemas, as a file and live. docs/foxglove.md lists the topics.
//!
//! The scene is what is said of a run; where it goes are destinations, which get the same messages.

mod file;
mod live;
mod scene;
mod topics;

pub use live::DEFAULT_ADDRESS;
pub use scene::Scene;
