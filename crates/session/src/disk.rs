//! A file that survives a full disk: data that could not be written waits in memory and is written when there is
//! room.
//!
//! Input: lines, each in one write. The file always consists of whole lines: a line cut short by a failed write is
//! removed before the next attempt, so that the file is readable at every moment.

use cairn_guide::Durable;
use std::fs::File;
use std::io::{self, Seek, SeekFrom, Write};
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError};

/// The medium under a patient file: a file that can be truncated.
pub trait Medium: Durable + Send {
    /// Truncates to `length` bytes and continues from there.
    ///
    /// # Errors
    /// The system's error.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl Medium for File {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)?;
        self.seek(SeekFrom::Start(length)).map(|_| ())
    }
}

impl Durable for Box<dyn Medium> {
    fn make_durable(&mut self) -> io::Result<()> {
        (**self).make_durable()
    }
}

impl Medium for Box<dyn Medium> {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        (**self).cut(length)
    }
}

/// Makes new files, where one that exists is an error, and replaces files.
pub trait Disk: Send {
    /// Creates an empty file.
    ///
    /// # Errors
    /// The system's error, also when the file exists.
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>>;

    /// Gives a file this content, completely or not at all.
    ///
    /// # Errors
    /// The system's error; the file is then as it was.
    fn replace(&self, path: &Path, content: &[u8]) -> io::Result<()>;
}

/// The machine's own file system.
#[derive(Clone, Copy, Debug, Default)]
pub struct OwnDisk;

impl Disk for OwnDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>> {
        Ok(Box::new(File::options().write(true).create_new(true).open(path)?))
    }

    fn replace(&self, path: &Path, content: &[u8]) -> io::Result<()> {
        // A neighbour that a killed process left behind is overwritten by the next attempt.
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(".new");
        let part = path.with_file_name(name);
        let written = File::create(&part).and_then(|mut file| {
            file.write_all(content)?;
            file.sync_all()
        });
        written.and_then(|()| std::fs::rename(&part, path)).inspect_err(|_| {
            let _ = std::fs::remove_file(&part);
        })?;
        match path.parent() {
            // The new name is on disk when the folder is.
            Some(folder) if !folder.as_os_str().is_empty() && cfg!(unix) => File::open(folder)?.sync_all(),
            _ => Ok(()),
        }
    }
}

/// Shared access to the current reason why writing fails.
#[derive(Clone, Debug, Default)]
pub struct Trouble(Arc<Mutex<Option<String>>>);

impl Trouble {
    /// Why the last write failed; `None` when all is on disk.
    pub fn now(&self) -> Option<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn set(&self, why: Option<String>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = why;
    }
}

/// The file. Its writes never fail; [`PatientFile::trouble`] reports when data is waiting.
pub struct PatientFile<M> {
    medium: M,
    /// Bytes of whole lines on the medium.
    good: u64,
    /// Data that is not written yet.
    waiting: Vec<u8>,
    trouble: Trouble,
}

impl<M: Medium> PatientFile<M> {
    /// On an empty medium.
    pub fn new(medium: M) -> Self {
        Self { medium, good: 0, waiting: Vec::new(), trouble: Trouble::default() }
    }

    /// The handle that reports whether writing fails at the moment.
    pub fn trouble(&self) -> Trouble {
        self.trouble.clone()
    }

    /// Writes as much of the waiting data as possible.
    fn push(&mut self) {
        if self.waiting.is_empty() {
            return;
        }
        if self.trouble.now().is_some()
            && let Err(e) = self.medium.cut(self.good)
        {
            return self.trouble.set(Some(e.to_string()));
        }
        match self.medium.write_all(&self.waiting) {
            Ok(()) => {
                self.good += self.waiting.len() as u64;
                self.waiting.clear();
                self.trouble.set(None);
            }
            Err(e) => {
                // A partial line on disk would make the file unreadable once the next line follows.
                let _ = self.medium.cut(self.good);
                self.trouble.set(Some(e.to_string()));
            }
        }
    }
}

impl<M: Medium> Write for PatientFile<M> {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        self.waiting.extend_from_slice(data);
        self.push();
        Ok(data.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl<M: Medium> Durable for PatientFile<M> {
    fn make_durable(&mut self) -> io::Result<()> {
        self.push();
        match (self.waiting.is_empty(), self.medium.make_durable()) {
            (true, Err(e)) => self.trouble.set(Some(e.to_string())),
            (true, Ok(())) => self.trouble.set(None),
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "../tests/suite/small/mod.rs"]
mod small;

#[cfg(test)]
mod tests {
    use super::small::Small;
    use super::*;

    #[test]
    fn full_disk_holds_whole_lines_and_catches_up() {
        let disk = Small::default();
        disk.0.lock().unwrap().1 = 25;
        let mut file = PatientFile::new(disk.clone());
        let mut all = Vec::new();
        for k in 0..10 {
            let line = format!("line {k:03}\n");
            file.write_all(line.as_bytes()).unwrap();
            all.extend_from_slice(line.as_bytes());
            let kept = disk.0.lock().unwrap().0.clone();
            assert!(kept.len().is_multiple_of(9) && all.starts_with(&kept), "{kept:?}");
        }
        assert_eq!(disk.0.lock().unwrap().0.len(), 18);
        assert!(file.trouble().now().unwrap().contains("no space"));
        disk.0.lock().unwrap().1 = 1000;
        file.make_durable().unwrap();
        assert_eq!(disk.0.lock().unwrap().0, all);
        assert_eq!(file.trouble().now(), None);
    }
}
