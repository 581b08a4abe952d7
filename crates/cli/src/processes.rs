//! Other processes: the programs that come with this one; and what `--isolated` runs and serves have in common: where processes
//! share memory, how they are started, and what is said of them.

use crate::output::note;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A program that comes with this one: beside it, else the one in PATH.
pub fn beside_or_in_path(program: &str) -> OsString {
    let file = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    let beside = std::env::current_exe().ok().map(|p| p.with_file_name(file)).filter(|p| p.is_file());
    beside.map_or_else(|| OsString::from(program), PathBuf::into_os_string)
}

/// Where the processes share memory.
pub const SHARED_MEMORY: &str = "/dev/shm";

/// The folder in which processes can share memory; `None` where there is none, which is said: all then is one process.
pub fn shared_memory() -> Option<&'static Path> {
    let folder = Path::new(SHARED_MEMORY);
    if cfg!(unix) && folder.is_dir() {
        return Some(folder);
    }
    note("this machine has no /dev/shm: the run is one process, and what kills it ends it");
    None
}

#[cfg(unix)]
pub use unix::{folder_in, line, this_program};

#[cfg(unix)]
mod unix {
    use super::*;
    use crate::failure::Failure;
    use crate::interrupt;
    use cairn_workers::{Role, RunEvent, RunFolder};
    use std::process::Command;

    /// A folder of this run, removed with it; what runs that were killed have left is removed too, and said.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn folder_in(parent: &Path) -> Result<RunFolder, Failure> {
        for (id, bytes) in cairn_workers::remove_abandoned(parent) {
            let mb = bytes as f64 / 1e6;
            note(&format!(
                "removed {mb:.0} MB of shared memory that a run which was killed has left (process {id})"
            ));
        }
        let folder = RunFolder::create(parent).map_err(|e| {
            Failure::new(SHARED_MEMORY, e.to_string(), "free some of it, or run without --isolated")
        })?;
        let removed = folder.path().to_owned();
        interrupt::before_exit(move || drop(std::fs::remove_dir_all(&removed)));
        Ok(folder)
    }

    /// This program with the same arguments, as a worker.
    pub fn this_program(role: Role) -> Command {
        let program = std::env::current_exe().unwrap_or_else(|_| "cairn".into());
        let mut command = Command::new(program);
        command.args(std::env::args_os().skip(1)).args(["--worker", role.name()]);
        command
    }

    /// What became of a process, in a line; `None` where nothing is to be said.
    pub fn line(told: &RunEvent) -> Option<String> {
        Some(match told {
            RunEvent::Started { role, id } => format!("{}: process {id}", role.name()),
            RunEvent::Died(death) if death.role == Role::Walk => format!("walk died: {}", death.how),
            RunEvent::Died(death) => {
                format!("{} died at frame {}: {}", death.role.name(), death.at_frame, death.how)
            }
            RunEvent::GivenUp { role } => {
                format!("{} died too often: the run goes on without it", role.name())
            }
            RunEvent::Waits { role, delay_s, times } => {
                format!("{} died {times} times in a row: it is started again after {delay_s} s", role.name())
            }
            RunEvent::Resumed { key_frames, after_s } => {
                format!("slam goes on in a map of {key_frames} key frames after {after_s:.2} s")
            }
            RunEvent::DenseResumed { key_frames, after_s } => {
                format!("dense goes on with the depth of {key_frames} key frames after {after_s:.2} s")
            }
            RunEvent::NoSurfaces(why) => format!("no surfaces any more: {why}"),
            RunEvent::Relocalised { frames, after_s, .. } => {
                format!("slam has a pose again after {after_s:.2} s, {frames} frames without one")
            }
            RunEvent::LeftOut { number } => format!("slam died twice at frame {number}: it is left out"),
            RunEvent::Opened(_) | RunEvent::Tracked(_) | RunEvent::Said(_) => return None,
        })
    }
}
