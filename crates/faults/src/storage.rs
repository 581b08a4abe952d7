//! A disk that is full or fails for a while, and loses at a power cut what was not made durable.

use crate::scenario::{Fault, Scenario};
use cairn_guide::Durable;
use cairn_random::Random;
use cairn_session::{Disk, Medium};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A file: what was written, and how much of it is durable.
#[derive(Clone, Default)]
struct Content {
    bytes: Vec<u8>,
    durable: usize,
}

struct State {
    random: Random,
    fails: bool,
    /// Calls left until the next failure begins or ends.
    calls: u32,
    is_failing: bool,
    files: BTreeMap<PathBuf, Content>,
}

/// The disk, shared with whoever looks at it after a power cut.
#[derive(Clone)]
pub(crate) struct VirtualDisk(Arc<Mutex<State>>);

impl VirtualDisk {
    /// An empty one.
    pub fn new(scenario: &Scenario) -> Self {
        let mut random = scenario.random(Fault::DiskFails as u64);
        let calls = random.below(400) as u32;
        let fails = scenario.faults.has(Fault::DiskFails);
        Self(Arc::new(Mutex::new(State { random, fails, calls, is_failing: false, files: BTreeMap::new() })))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// What is left of a file after a power cut.
    pub fn after_power_cut(&self, path: &Path) -> Option<Vec<u8>> {
        self.lock().files.get(path).map(|file| file.bytes[..file.durable].to_vec())
    }
}

impl State {
    /// Counts a call; true where it fails.
    fn call(&mut self) -> bool {
        if !self.fails {
            return false;
        }
        if self.calls == 0 {
            self.is_failing = !self.is_failing;
            self.calls = 1 + self.random.below(if self.is_failing { 60 } else { 400 }) as u32;
        }
        self.calls -= 1;
        self.is_failing
    }
}

fn full() -> io::Error {
    io::Error::new(io::ErrorKind::StorageFull, "no space left on device")
}

struct VirtualFile {
    disk: VirtualDisk,
    path: PathBuf,
}

impl Write for VirtualFile {
    fn write(&mut self, data: &[u8]) -> io::Result<usize> {
        let mut state = self.disk.lock();
        let fails = state.call();
        // A write that fails has written a part.
        let n = if fails { state.random.below(data.len().max(1)) } else { data.len() };
        let file = state.files.entry(self.path.clone()).or_default();
        file.bytes.extend_from_slice(&data[..n]);
        if fails && n == 0 { Err(full()) } else { Ok(n) }
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Durable for VirtualFile {
    fn make_durable(&mut self) -> io::Result<()> {
        let mut state = self.disk.lock();
        if state.call() {
            return Err(full());
        }
        let file = state.files.entry(self.path.clone()).or_default();
        file.durable = file.bytes.len();
        Ok(())
    }
}

impl Medium for VirtualFile {
    fn cut(&mut self, length: u64) -> io::Result<()> {
        let mut state = self.disk.lock();
        if state.call() {
            return Err(full());
        }
        let file = state.files.entry(self.path.clone()).or_default();
        file.bytes.truncate(length as usize);
        file.durable = file.durable.min(file.bytes.len());
        Ok(())
    }
}

impl Disk for VirtualDisk {
    fn create(&self, path: &Path) -> io::Result<Box<dyn Medium>> {
        let mut state = self.lock();
        if state.call() {
            return Err(full());
        }
        if state.files.contains_key(path) {
            return Err(io::Error::new(io::ErrorKind::AlreadyExists, "the file exists"));
        }
        state.files.insert(path.to_owned(), Content::default());
        Ok(Box::new(VirtualFile { disk: self.clone(), path: path.to_owned() }))
    }

    fn replace(&self, path: &Path, content: &[u8]) -> io::Result<()> {
        let mut state = self.lock();
        if state.call() {
            return Err(full());
        }
        state.files.insert(path.to_owned(), Content { bytes: content.to_vec(), durable: content.len() });
        Ok(())
    }
}
