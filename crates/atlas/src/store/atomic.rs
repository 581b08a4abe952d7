//! Atomic file writes: a file has either its complete new content or its previous one.
//!
//! The new content goes into a temporary neighbour file, is synced to disk, and then renamed; the folder is
//! synced too. On any error the neighbour is removed. One left behind by a killed process is removed by the
//! next save of the same file: its owner held a lock on it that ends with the process.

use super::beside::process_id;
use super::error::StoreError;
use std::ffi::{OsStr, OsString};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Distinguishes files that one process saves at the same time.
static COUNT: AtomicU32 = AtomicU32::new(0);

/// Writes what `write` produces to `path`, completely or not at all.
pub(crate) fn write_whole<T>(
    path: &Path,
    write: impl FnOnce(&mut File) -> Result<T, StoreError>,
) -> Result<T, StoreError> {
    let name = path.file_name().ok_or_else(|| StoreError::File {
        path: path.to_owned(),
        doing: "cannot write",
        source: std::io::Error::other("the path names no file"),
    })?;
    if path.is_dir() {
        let source = std::io::Error::other("it is a folder");
        return Err(StoreError::File { path: path.to_owned(), doing: "cannot write", source });
    }
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    remove_left_behind(folder, name);
    let (part, mut file) = neighbour(folder, name).map_err(StoreError::file(path, "cannot write"))?;
    let done = write(&mut file).map_err(|e| match e {
        StoreError::File { doing, source, .. } => StoreError::File { path: path.to_owned(), doing, source },
        other => other,
    });
    let done = done.and_then(|value| {
        file.sync_all().map_err(StoreError::file(path, "cannot write to the disk"))?;
        std::fs::rename(&part, path).map_err(StoreError::file(path, "cannot take its name"))?;
        Ok(value)
    });
    match &done {
        Ok(_) => sync_folder(folder).map_err(StoreError::file(folder, "cannot write to the disk"))?,
        Err(_) => drop(std::fs::remove_file(&part)),
    }
    done
}

/// Prefix of the names of the neighbours of `name`.
fn prefix(name: &OsStr) -> OsString {
    let mut prefix = OsString::from(".");
    prefix.push(name);
    prefix.push(".saving-");
    prefix
}

/// A new neighbour, locked for as long as it is open.
fn neighbour(folder: &Path, name: &OsStr) -> std::io::Result<(PathBuf, File)> {
    loop {
        let mut part = prefix(name);
        part.push(format!("{}-{}", process_id(), COUNT.fetch_add(1, Ordering::Relaxed)));
        let part = folder.join(part);
        let file = match File::options().read(true).write(true).create_new(true).open(&part) {
            // Left behind by an earlier process with the same id, on a file system without locks.
            Err(e) if e.kind() == std::io::ErrorKind::AlreadyExists => continue,
            opened => opened?,
        };
        // Where there are no locks, nothing is removed either.
        let _ = file.lock();
        // Between opening and locking, another process may have removed it as left behind.
        if part.exists() {
            return Ok((part, file));
        }
    }
}

/// Removes neighbours whose owner has ended.
fn remove_left_behind(folder: &Path, name: &OsStr) {
    let prefix = prefix(name);
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        let found = entry.file_name();
        if !found.as_encoded_bytes().starts_with(prefix.as_encoded_bytes()) {
            continue;
        }
        let Ok(file) = File::options().write(true).open(entry.path()) else { continue };
        if let Err(TryLockError::WouldBlock | TryLockError::Error(_)) = file.try_lock() {
            continue;
        }
        let _ = std::fs::remove_file(entry.path());
    }
}

#[cfg(unix)]
fn sync_folder(folder: &Path) -> std::io::Result<()> {
    File::open(folder)?.sync_all()
}

/// Elsewhere folders cannot be opened; the rename is as durable as the system makes it.
#[cfg(not(unix))]
fn sync_folder(_: &Path) -> std::io::Result<()> {
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Write;

    fn folder(name: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("cairn-atlas-atomic-{}-{name}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        path
    }

    fn put(path: &Path, text: &str) -> Result<(), StoreError> {
        write_whole(path, |file| {
            file.write_all(text.as_bytes()).map_err(StoreError::file(path, "cannot write"))
        })
    }

    #[test]
    fn error_keeps_the_previous_file_only() {
        let folder = folder("error");
        let path = folder.join("a.map");
        put(&path, "one").unwrap();
        put(&path, "two").unwrap();
        let error = write_whole(&path, |file| {
            file.write_all(b"half").unwrap();
            Err::<(), _>(StoreError::CombineError("on purpose".into()))
        });
        assert!(error.is_err());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "two");
        assert_eq!(std::fs::read_dir(&folder).unwrap().count(), 1);
        let message = put(&folder.join("none/b.map"), "x").unwrap_err().to_string();
        assert!(message.contains("none/b.map: cannot write"), "{message}");
        assert!(put(&folder, "x").unwrap_err().to_string().contains("it is a folder"));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn stale_neighbours_are_removed_and_locked_ones_kept() {
        let folder = folder("left");
        let path = folder.join("a.map");
        let left = folder.join(".a.map.saving-999999999-0");
        std::fs::write(&left, "half").unwrap();
        let (part, file) = neighbour(&folder, OsStr::new("a.map")).unwrap();
        put(&path, "one").unwrap();
        assert!(!left.exists(), "nobody holds it");
        assert!(part.exists(), "it is being written");
        drop(file);
        put(&path, "two").unwrap();
        assert!(!part.exists());
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
