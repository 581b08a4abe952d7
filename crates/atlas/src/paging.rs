//! Paging out: features and words of key frames that nobody has looked at for a while go into a file without a name in the
//! folder for temporary files, from which they are read back when somebody does.
//!
//! In: each new version before it is published. Out: the same version with some values on disk. A key frame's features never
//! change, so each is written once; what has been written stays in the file until the map is dropped. Where the file cannot be
//! made or written, everything stays in memory.

use crate::Snapshot;
use crate::paged::{Faults, Paged, ReadBackError, Source};
use crate::record::Record;
use std::fmt::Debug;
use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Key frames with features in memory: below this nothing is paged out.
const IN_MEMORY: usize = 256;
/// The newest key frames stay in memory.
const NEWEST: usize = 64;
/// New key frames from one sweep to the next.
const EVERY: usize = 32;

/// Distinguishes the files of one process.
static COUNT: AtomicU32 = AtomicU32::new(0);

/// Pages out, from time to time.
#[derive(Debug, Default)]
pub(crate) struct Paging {
    file: Option<Arc<PageFile>>,
    /// The next sweep takes place with this many key frames.
    next: usize,
    failed: bool,
}

impl Paging {
    /// Pages out what was not used since the last sweep, where it is time for a sweep.
    pub fn sweep(&mut self, snapshot: &mut Snapshot) {
        if self.failed || snapshot.next_key_frame < self.next {
            return;
        }
        self.next = snapshot.next_key_frame + EVERY;
        let old = snapshot.next_key_frame.saturating_sub(NEWEST);
        let in_memory = || snapshot.key_frames.iter().filter(|(_, k)| k.frame.in_memory().is_some());
        if in_memory().count() <= IN_MEMORY {
            return;
        }
        let unused: Vec<usize> = in_memory()
            .take_while(|(index, _)| *index < old)
            .filter(|(_, k)| !(k.frame.was_used() | k.bag.was_used()))
            .map(|(index, _)| index)
            .collect();
        if let Err(_unwritable) = unused.into_iter().try_for_each(|index| self.page_out(snapshot, index)) {
            self.failed = true;
        }
    }

    fn page_out(&mut self, snapshot: &mut Snapshot, index: usize) -> io::Result<()> {
        let file = match &self.file {
            Some(file) => file,
            None => self.file.insert(Arc::new(PageFile::new(snapshot.faults.clone())?)),
        };
        let Some(k) = snapshot.key_frames.get_mut(index) else { return Ok(()) };
        (k.frame, k.bag) = (file.paged_out(&k.frame)?, file.paged_out(&k.bag)?);
        Ok(())
    }
}

/// The file, which has no name where the system allows that.
#[derive(Debug)]
struct PageFile {
    file: Mutex<File>,
    /// Where it has a name.
    path: Option<PathBuf>,
    faults: Faults,
}

impl PageFile {
    fn new(faults: Faults) -> io::Result<Self> {
        let name = format!("cairn-pages-{}-{}", std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let path = std::env::temp_dir().join(name);
        let file = File::options().read(true).write(true).create_new(true).open(&path)?;
        // Where an open file can be removed, it ends with the process, however that ends.
        let path = std::fs::remove_file(&path).is_err().then_some(path);
        Ok(Self { file: Mutex::new(file), path, faults })
    }

    fn file(&self) -> MutexGuard<'_, File> {
        self.file.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The same value on disk; it is written where it is not there yet.
    fn paged_out<T: Record + Default + Debug + Send + Sync + 'static>(
        self: &Arc<Self>,
        value: &Paged<T>,
    ) -> io::Result<Paged<T>> {
        if let Some(source) = value.source() {
            return Ok(Paged::on_disk(source.clone()));
        }
        let mut bytes = Vec::new();
        value.encode(&mut bytes);
        let at = {
            let mut file = self.file();
            let at = file.seek(SeekFrom::End(0))?;
            file.write_all(&bytes)?;
            at
        };
        let (crc, features) = (crc32fast::hash(&bytes), value.features() as u32);
        let page = Page { file: self.clone(), at, bytes: bytes.len() as u32, crc, features };
        Ok(Paged::on_disk(Arc::new(page)))
    }
}

impl Drop for PageFile {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // It is in the folder for temporary files.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A value in the file.
#[derive(Debug)]
struct Page {
    file: Arc<PageFile>,
    at: u64,
    bytes: u32,
    crc: u32,
    features: u32,
}

impl<T: Record> Source<T> for Page {
    fn read(&self) -> Result<Arc<T>, ReadBackError> {
        let mut bytes = vec![0; self.bytes as usize];
        let read = {
            let mut file = self.file.file();
            file.seek(SeekFrom::Start(self.at)).and_then(|_| file.read_exact(&mut bytes))
        };
        read.map_err(ReadBackError::Pages)?;
        let value = (crc32fast::hash(&bytes) == self.crc).then(|| T::decode(&bytes)).flatten();
        value.map(Arc::new).ok_or(ReadBackError::Altered)
    }

    fn placeholder(&self, fault: ReadBackError) -> Arc<T> {
        self.file.faults.keep(fault);
        Arc::new(T::placeholder(self.features as usize))
    }
}
