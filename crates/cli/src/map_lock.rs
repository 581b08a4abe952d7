//! One writer per map file: a lock beside it that ends with the process.
//!
//! Saving replaces the map file, so the lock is on a neighbour, `.NAME.lock`. The operating system releases it
//! however the process ends; a neighbour left behind by a killed process is taken over. On file systems without
//! locks there is no protection.

use crate::failure::Failure;
use std::fs::{File, TryLockError};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

/// The right to write a map file, given back when dropped.
pub struct MapLock {
    path: PathBuf,
    _file: File,
}

impl MapLock {
    /// Takes the lock of this map file.
    ///
    /// # Errors
    /// When another process holds it, or the neighbour cannot be created.
    pub fn take(map: &Path) -> Result<Self, Failure> {
        let mut name = std::ffi::OsString::from(".");
        name.push(map.file_name().unwrap_or_default());
        name.push(".lock");
        let path = map.with_file_name(name);
        let shown = map.display().to_string();
        let fail = |e: std::io::Error| {
            let hint = "check that its folder is writable and that the disk has room";
            Failure::new(&shown, format!("cannot lock it with {}: {e}", path.display()), hint)
        };
        loop {
            let open = File::options().read(true).write(true).create(true).truncate(false).open(&path);
            let mut file = open.map_err(fail)?;
            match file.try_lock() {
                Err(TryLockError::WouldBlock) => return Err(held(&shown, &mut file)),
                // The former owner may have removed the neighbour between opening and locking.
                Ok(()) if !is_at(&file, &path) => continue,
                Ok(()) | Err(TryLockError::Error(_)) => {}
            }
            let owner = format!("{}\n", std::process::id());
            file.set_len(0).and_then(|()| file.write_all(owner.as_bytes())).map_err(fail)?;
            return Ok(Self { path, _file: file });
        }
    }
}

impl Drop for MapLock {
    fn drop(&mut self) {
        // Removed while it is still locked; one that remains does no harm.
        let _ = std::fs::remove_file(&self.path);
    }
}

/// The failure that names the process that holds the lock.
fn held(shown: &str, file: &mut File) -> Failure {
    let mut owner = String::new();
    let _ = file.take(32).read_to_string(&mut owner);
    let process = match owner.trim() {
        "" => "another process".to_owned(),
        id => format!("process {id}"),
    };
    let hint = "wait until it ends, or give another file for the map";
    Failure::new(shown, format!("{process} is writing this map"), hint)
}

/// Whether the open file is still the one at the path.
#[cfg(unix)]
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let (Ok(open), Ok(there)) = (file.metadata(), std::fs::metadata(path)) else { return false };
    (open.dev(), open.ino()) == (there.dev(), there.ino())
}

#[cfg(not(unix))]
fn is_at(_: &File, path: &Path) -> bool {
    path.exists()
}
