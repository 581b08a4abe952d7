#![doc = include_str!("../README.md")]

mod build;
mod digest;
mod error;
mod fetch;
mod job;
mod place_index;
mod places;
mod recording;
mod run;
mod scale;
mod seen;
mod shelf;
mod steps;
mod store;
mod task;

pub use build::{Build, Cost, Report};
pub use digest::{Digest, NotADigest};
pub use error::FleetError;
pub use fetch::{Answer, Evidence, Fetched, Found, Query, fetch, find, query_of};
pub use job::Job;
pub use run::run;
pub use scale::{Built, City, StepLoad};
pub use seen::Seen;
pub use store::{Listed, Store, open};
pub use task::{
    Atlas, Blob, Joined, Mapped, Merged, Outcome, Pair, Paired, Published, Result as StepResult, Source,
    Task, Tile, Tiled, Verified,
};
