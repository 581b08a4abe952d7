//! A store in a folder of this machine, or of a file system that all workers share.
//!
//! An object is written to a file of another name, synced, and then takes its name: by a hard link where it must be new, which fails
//! where the name exists, else by renaming. A file that a killed worker left behind has a name that no listing shows.

use super::{Listed, Store};
use crate::FleetError;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Prefix of files that are being written.
const PART: &str = ".part-";
static COUNT: AtomicU32 = AtomicU32::new(0);

pub(super) struct Folder {
    root: PathBuf,
}

impl Folder {
    pub(super) fn new(root: &str) -> Self {
        Self { root: PathBuf::from(root) }
    }

    fn path(&self, name: &str) -> PathBuf {
        if name.is_empty() { self.root.clone() } else { self.root.join(name) }
    }

    /// Writes a file of another name beside `path`.
    fn part(&self, path: &Path, bytes: &[u8]) -> std::io::Result<PathBuf> {
        let folder = path.parent().unwrap_or(&self.root);
        std::fs::create_dir_all(folder)?;
        let id = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let part = folder.join(format!("{PART}{}-{}", id.0, id.1));
        let mut file = File::create(&part)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        Ok(part)
    }
}

fn unread(path: &Path) -> impl Fn(std::io::Error) -> FleetError {
    let what = path.display().to_string();
    move |e| FleetError::new(&what, e, "check that it exists and may be read")
}

fn unwritten(path: &Path) -> impl Fn(std::io::Error) -> FleetError {
    let what = path.display().to_string();
    move |e| FleetError::new(&what, e, "check that its folder may be written and that the disk has room")
}

impl Store for Folder {
    fn get(&self, name: &str) -> Result<Option<Vec<u8>>, FleetError> {
        let path = self.path(name);
        match std::fs::read(&path) {
            Ok(bytes) => Ok(Some(bytes)),
            Err(e) if e.kind() == ErrorKind::NotFound => Ok(None),
            Err(e) => Err(unread(&path)(e)),
        }
    }

    fn get_range(&self, name: &str, range: Range<u64>) -> Result<Vec<u8>, FleetError> {
        let path = self.path(name);
        let read = || {
            let mut file = File::open(&path)?;
            let length = file.metadata()?.len();
            if range.end > length || range.start > range.end {
                return Err(std::io::Error::other(format!("it has {length} bytes, not {}", range.end)));
            }
            let mut bytes = vec![0; (range.end - range.start) as usize];
            file.seek(SeekFrom::Start(range.start))?;
            file.read_exact(&mut bytes)?;
            Ok(bytes)
        };
        read().map_err(unread(&path))
    }

    fn put_new(&self, name: &str, bytes: &[u8]) -> Result<bool, FleetError> {
        let path = self.path(name);
        if path.exists() {
            return Ok(false);
        }
        let part = self.part(&path, bytes).map_err(unwritten(&path))?;
        let linked = std::fs::hard_link(&part, &path);
        let removed = std::fs::remove_file(&part);
        match linked {
            Ok(()) => removed.map(|()| true).map_err(unwritten(&part)),
            Err(e) if e.kind() == ErrorKind::AlreadyExists => Ok(false),
            Err(e) => Err(unwritten(&path)(e)),
        }
    }

    fn put(&self, name: &str, bytes: &[u8]) -> Result<(), FleetError> {
        let path = self.path(name);
        let part = self.part(&path, bytes).map_err(unwritten(&path))?;
        std::fs::rename(&part, &path).map_err(unwritten(&path))
    }

    fn children(&self, prefix: &str) -> Result<Vec<String>, FleetError> {
        let path = self.path(prefix);
        let entries = std::fs::read_dir(&path).map_err(unread(&path))?;
        let mut names = Vec::new();
        for entry in entries {
            let name = entry.map_err(unread(&path))?.file_name();
            let text = name.into_string().map_err(|name| {
                FleetError::new(
                    path.join(name).display().to_string(),
                    "its name is not UTF-8",
                    "give it another name",
                )
            })?;
            if !text.starts_with('.') {
                names.push(text);
            }
        }
        names.sort();
        Ok(names)
    }

    fn list(&self, prefix: &str) -> Result<Vec<Listed>, FleetError> {
        let path = self.path(prefix);
        let about = std::fs::metadata(&path).map_err(unread(&path))?;
        if about.is_file() {
            return Ok(vec![Listed { name: String::new(), bytes: about.len(), tag: None }]);
        }
        let mut all = Vec::new();
        for child in self.children(prefix)? {
            let below = if prefix.is_empty() { child.clone() } else { format!("{prefix}/{child}") };
            all.extend(self.list(&below)?.into_iter().map(|mut listed| {
                listed.name =
                    if listed.name.is_empty() { child.clone() } else { format!("{child}/{}", listed.name) };
                listed
            }));
        }
        all.sort_by(|a, b| a.name.cmp(&b.name));
        Ok(all)
    }

    fn local(&self, name: &str) -> Option<PathBuf> {
        Some(self.path(name))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_are_written_once_read_in_parts_and_listed() {
        let root = std::env::temp_dir().join(format!("cairn-fleet-folder-{}", std::process::id()));
        let store = Folder::new(root.to_str().unwrap());
        assert_eq!(store.get("a/b").unwrap(), None);
        assert!(store.put_new("a/b", b"first").unwrap());
        assert!(!store.put_new("a/b", b"other").unwrap());
        assert_eq!(store.get("a/b").unwrap().unwrap(), b"first");
        assert_eq!(store.get_range("a/b", 1..3).unwrap(), b"ir");
        assert!(store.get_range("a/b", 1..9).unwrap_err().to_string().contains("it has 5 bytes"));
        store.put("a/b", b"second").unwrap();
        assert_eq!(store.get("a/b").unwrap().unwrap(), b"second");
        store.put("c", b"x").unwrap();
        // What a killed worker leaves behind.
        std::fs::write(root.join("a/.part-1-1"), b"ha").unwrap();
        assert_eq!(store.children("").unwrap(), ["a", "c"]);
        let names: Vec<_> = store.list("").unwrap().into_iter().map(|l| (l.name, l.bytes)).collect();
        assert_eq!(names, [("a/b".to_owned(), 6), ("c".to_owned(), 1)]);
        assert_eq!(store.list("c").unwrap()[0].name, "");
        std::fs::remove_dir_all(&root).unwrap();
    }

    #[test]
    fn of_many_writers_of_one_name_one_wins() {
        let root = std::env::temp_dir().join(format!("cairn-fleet-writers-{}", std::process::id()));
        let won: usize = std::thread::scope(|scope| {
            let writers: Vec<_> = (0..8u8)
                .map(|n| {
                    let store = Folder::new(root.to_str().unwrap());
                    scope.spawn(move || usize::from(store.put_new("k", &[n; 4096]).unwrap()))
                })
                .collect();
            writers.into_iter().map(|w| w.join().unwrap()).sum()
        });
        assert_eq!(won, 1);
        let bytes = std::fs::read(root.join("k")).unwrap();
        assert!(bytes.len() == 4096 && bytes.iter().all(|b| *b == bytes[0]));
        std::fs::remove_dir_all(&root).unwrap();
    }
}
