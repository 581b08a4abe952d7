//! What a process does at its beginning: a worker bounds its memory and ties its life to the supervisor's, a server raises the
//! number of its files.

use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::io;

/// Bounds the memory that this process may write to (heap, stacks, private mappings); an allocation beyond it aborts the
/// process, and the supervisor starts it again in the map of the journal.
///
/// # Errors
/// The system's, as for a bound above that of the user.
pub fn limit_memory(bytes: u64) -> io::Result<()> {
    let maximum = getrlimit(Resource::Data).maximum;
    Ok(setrlimit(Resource::Data, Rlimit { current: Some(bytes), maximum })?)
}

/// Raises the number of files and connections that this process may have open to what its user may have; returns it.
pub fn raise_open_files() -> u64 {
    let limit = getrlimit(Resource::Nofile);
    let raised = Rlimit { current: limit.maximum, maximum: limit.maximum };
    let now = if setrlimit(Resource::Nofile, raised).is_ok() { limit.maximum } else { limit.current };
    now.unwrap_or(u64::MAX)
}

/// Lets the system kill this process when its parent ends, even while it is stopped. Elsewhere than on Linux a worker ends
/// when it next reads from the pipe of its supervisor.
pub fn die_with_parent() {
    #[cfg(target_os = "linux")]
    // Without it the pipe still ends the worker.
    let _ = rustix::process::set_parent_process_death_signal(Some(rustix::process::Signal::KILL));
}
