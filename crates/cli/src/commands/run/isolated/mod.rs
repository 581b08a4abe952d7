//! `--isolated`: the run as processes of this program under a supervisor, each of which may die.
//!
//! The same command line runs them all: the supervisor adds `--worker ROLE` for each process that it starts.

#[cfg(unix)]
mod monitor;
#[cfg(unix)]
mod saver;
#[cfg(unix)]
mod several;
#[cfg(unix)]
mod supervisor;
#[cfg(unix)]
mod worker;

use super::arguments::Arguments;
use crate::failure::Failure;
#[cfg(not(unix))]
use crate::output::Output;
#[cfg(not(unix))]
use crate::outputs::Outputs;
use crate::processes;
use std::path::Path;
#[cfg(not(unix))]
use std::time::Instant;

/// The folder in which processes can share memory; `None` where there is none, which is said: the run then is one process.
///
/// # Errors
/// For a live source.
pub fn shared_memory(a: &Arguments) -> Result<Option<&'static Path>, Failure> {
    if cairn_sources::is_live(&a.source) {
        let hint = "leave out --isolated, or record it first and run the recording";
        return Err(Failure::usage("--isolated", "live sources are not supported yet", hint));
    }
    Ok(processes::shared_memory())
}

#[cfg(unix)]
pub use supervisor::supervise;
#[cfg(unix)]
pub use worker::work;

/// There is no shared memory ([`shared_memory`]), and nobody starts a worker.
#[cfg(not(unix))]
pub fn work(_: &Arguments) -> Result<(), Failure> {
    Err(Failure::usage("--worker", "it needs Unix", "leave it out"))
}

/// As [`work`].
#[cfg(not(unix))]
pub fn supervise(_: &Arguments, _: &Outputs, _: &Output, _: Instant, _: &Path) -> Result<(), Failure> {
    Err(Failure::usage("--isolated", "it needs Unix", "leave it out"))
}
