//! Random access to bytes: a file read through a small window, or a decompressed chunk in memory.
//!
//! Every length found in a file is checked against the bytes that are there before it is used.

use crate::error::{BagError, Damage};
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes read from a file at once when only headers are needed.
const WINDOW: u64 = 16 << 10;

/// Bytes of known length.
pub(crate) trait Area {
    /// The number of bytes.
    fn end(&self) -> u64;

    /// Returns `n` bytes from `at`.
    ///
    /// # Errors
    /// When the area is too short, or the file cannot be read there.
    fn get(&mut self, at: u64, n: u64) -> Result<&[u8], Damage>;

    /// The `N` bytes of a little-endian number.
    fn array<const N: usize>(&mut self, at: u64) -> Result<[u8; N], Damage>
    where
        Self: Sized,
    {
        let mut out = [0; N];
        out.copy_from_slice(self.get(at, N as u64)?);
        Ok(out)
    }

    /// An unsigned 32-bit number.
    fn u32(&mut self, at: u64) -> Result<u32, Damage>
    where
        Self: Sized,
    {
        self.array(at).map(u32::from_le_bytes)
    }

    /// An unsigned 64-bit number.
    fn u64(&mut self, at: u64) -> Result<u64, Damage>
    where
        Self: Sized,
    {
        self.array(at).map(u64::from_le_bytes)
    }
}

/// The error for reading `n` bytes at `at` where only `end` are there.
fn beyond(at: u64, n: u64, end: u64) -> Damage {
    let there = end.saturating_sub(at);
    Damage::new(at, format!("{n} bytes should follow, the file has {there} more"))
}

/// Whether `n` bytes from `at` lie before `end`.
fn within(at: u64, n: u64, end: u64) -> bool {
    at.checked_add(n).is_some_and(|last| last <= end)
}

/// A file and the part of it that was last read.
pub(crate) struct InputFile {
    file: File,
    path: PathBuf,
    end: u64,
    window: Vec<u8>,
    window_at: u64,
}

impl InputFile {
    /// Opens a file.
    pub fn open(path: &Path) -> Result<Self, BagError> {
        let io = |source| BagError::Io { path: path.display().to_string(), source };
        let file = File::open(path).map_err(io)?;
        let about = file.metadata().map_err(io)?;
        if !about.is_file() {
            return Err(BagError::Unsupported {
                path: path.display().to_string(),
                why: "is not a file".into(),
                cure: "give a .bag, .db3 or .mcap file".into(),
            });
        }
        Ok(Self { file, path: path.to_owned(), end: about.len(), window: Vec::new(), window_at: 0 })
    }

    /// The path, for messages.
    pub fn shown(&self) -> String {
        self.path.display().to_string()
    }

    /// The error for damage in this file.
    pub fn damaged(&self, damage: Damage) -> BagError {
        BagError::Damaged { path: self.shown(), at: damage.at, why: damage.why }
    }

    /// A copy of `n` bytes; a file that is too short is an error.
    pub fn read(&mut self, at: u64, n: u64) -> Result<Vec<u8>, Damage> {
        if !within(at, n, self.end) {
            return Err(beyond(at, n, self.end));
        }
        let mut out = vec![0; n as usize];
        self.fill(at, &mut out)?;
        Ok(out)
    }

    fn fill(&mut self, at: u64, out: &mut [u8]) -> Result<(), Damage> {
        let mut from = |file: &mut File| {
            file.seek(SeekFrom::Start(at))?;
            file.read_exact(out)
        };
        from(&mut self.file).map_err(|e| Damage::new(at, format!("cannot be read ({e})")))
    }
}

impl Area for InputFile {
    fn end(&self) -> u64 {
        self.end
    }

    fn get(&mut self, at: u64, n: u64) -> Result<&[u8], Damage> {
        if !within(at, n, self.end) {
            return Err(beyond(at, n, self.end));
        }
        let held = self.window.len() as u64;
        if at < self.window_at || at + n > self.window_at + held {
            let size = n.max(WINDOW).min(self.end - at);
            let mut window = std::mem::take(&mut self.window);
            window.resize(size as usize, 0);
            window.truncate(size as usize);
            self.fill(at, &mut window)?;
            (self.window, self.window_at) = (window, at);
        }
        let start = (at - self.window_at) as usize;
        Ok(&self.window[start..start + n as usize])
    }
}

/// Bytes in memory.
pub(crate) struct Memory<'a>(pub &'a [u8]);

impl Area for Memory<'_> {
    fn end(&self) -> u64 {
        self.0.len() as u64
    }

    fn get(&mut self, at: u64, n: u64) -> Result<&[u8], Damage> {
        if !within(at, n, self.end()) {
            return Err(beyond(at, n, self.end()));
        }
        Ok(&self.0[at as usize..(at + n) as usize])
    }
}
