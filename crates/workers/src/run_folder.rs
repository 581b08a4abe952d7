//! The folder of a run in shared memory: its ring, its rig, the journal of its map. Removed with the run.

use std::fs;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

/// Where processes share memory.
pub const SHARED_MEMORY: &str = "/dev/shm";
const PREFIX: &str = "cairn-";

/// A folder that is removed when this is dropped.
#[derive(Debug)]
pub struct RunFolder(PathBuf);

impl RunFolder {
    /// A new folder for this process under `parent`.
    ///
    /// # Errors
    /// The system's, as where there is no `/dev/shm`.
    pub fn create(parent: &Path) -> io::Result<Self> {
        let path = parent.join(format!("{PREFIX}{}", std::process::id()));
        // Left by an earlier process with the same id.
        let _ = fs::remove_dir_all(&path);
        fs::DirBuilder::new().mode(0o700).create(&path)?;
        Ok(Self(path))
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// The ring of frames.
    pub fn ring(&self) -> PathBuf {
        ring_in(&self.0)
    }
}

/// The ring of frames in the folder of a run.
pub(crate) fn ring_in(folder: &Path) -> PathBuf {
    folder.join("frames.ring")
}

impl Drop for RunFolder {
    fn drop(&mut self) {
        // What stays is removed by a later run.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Removes the folders of runs that were killed; returns the process ids and the bytes that became free.
pub fn remove_abandoned(parent: &Path) -> Vec<(u32, u64)> {
    let Ok(entries) = fs::read_dir(parent) else { return Vec::new() };
    let mut removed = Vec::new();
    for path in entries.filter_map(|e| Some(e.ok()?.path())) {
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let Some(id) = name.strip_prefix(PREFIX).and_then(|id| id.parse::<u32>().ok()) else { continue };
        if is_running(id) {
            continue;
        }
        let bytes = bytes_of(&path);
        // Another user's stays.
        if fs::remove_dir_all(&path).is_ok() {
            removed.push((id, bytes));
        }
    }
    removed
}

fn is_running(id: u32) -> bool {
    let pid = i32::try_from(id).ok().and_then(rustix::process::Pid::from_raw);
    // Not permitted to ask means that it is there.
    pid.is_some_and(|pid| rustix::process::test_kill_process(pid) != Err(rustix::io::Errno::SRCH))
}

fn bytes_of(folder: &Path) -> u64 {
    let Ok(entries) = fs::read_dir(folder) else { return 0 };
    entries.filter_map(|e| Some(e.ok()?.metadata().ok()?.len())).sum()
}
