//! `cairn run`: SLAM on any source; writes trajectories, maps, routes, and a report as JSON and HTML.
//!
//! A run is a source, a session and a list of sinks ([`sink::Sink`]), in this process ([`here`]) or in several ([`isolated`]).

mod arguments;
mod events;
mod files;
mod foxglove;
mod here;
mod history;
mod isolated;
mod journal;
mod map;
mod outcome;
mod page;
mod picture;
mod played;
mod poses;
mod problems;
mod rerun;
mod results;
mod route;
mod say;
mod sensor;
mod sink;
mod sinks;
mod source;
mod status;
mod status_tally;
mod surface;
mod tally;
mod team;
mod text;
mod truth;
mod walker;

use crate::failure::Failure;
use crate::output::Output;
pub use arguments::Arguments;
pub use sensor::sensors;
use std::time::Instant;

/// Runs the engine over the source, then writes the requested results. `began` is when the process started.
///
/// # Errors
/// When an input cannot be used, the run fails or gives no pose, or a result cannot be written. Once a frame has been
/// processed, every result is written all the same.
pub fn run(a: &Arguments, output: &Output, began: Instant) -> Result<(), Failure> {
    if a.isolated.worker.is_some() {
        return isolated::work(a);
    }
    let outputs = files::checked(a)?;
    if a.isolated.isolated
        && let Some(parent) = isolated::shared_memory(a)?
    {
        return isolated::supervise(a, &outputs, output, began, parent);
    }
    here::run(a, &outputs, output, began)
}
