//! Processes under a supervisor on a recording: equal results, and what is killed or stopped goes on.
//!
//! This program is its own worker: with the arguments `worker ROLE` it captures or tracks, without it runs the tests whose
//! names contain the first argument.

#[cfg(unix)]
mod supervised;

fn main() {
    #[cfg(unix)]
    supervised::main();
}
