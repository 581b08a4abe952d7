//! The journal of a map: a saved base and every commit since, in a folder that outlives the process that writes it.
//!
//! SLAM appends each commit as soon as it knows of it (after every frame, and at every ping: 100 ms). What `write` has
//! taken survives the death of the process. [`recover`] reads the base, applies the commits in order of their versions and
//! stops at the first that is not whole, which is where the writer was killed. Others follow the same files while they
//! are written ([`Tail`]).
//!
//! ```text
//! map-VERSION.cairn       a saved map (atlas::store)
//! changes-VERSION.log     magic 8 | format u32, then commits later than VERSION: length u32 | crc32 u32 | bytes
//! ```
//!
//! Once the log has [`MAX_LOG_BYTES`], or more commits than are read back in a moment, a new base is saved on a thread while
//! commits go on into the next log. The old base is removed when it is complete, the log before it with the next one: who
//! follows it has read it by then.

mod tail;

pub use tail::Tail;

use cairn_atlas::store::{COMMIT_VERSION, MapFile, StoreError, decode_commit, encode_commit};
use cairn_atlas::{ChangeSet, Published, Snapshot};
use std::fs::{self, File};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// A log as long as this gets a successor.
pub const MAX_LOG_BYTES: u64 = 32 << 20;
/// So does one of so many commits, and one more for each [`BYTES_A_COMMIT`] of the base: reading a commit takes 0.1 ms and more
/// however small it is, a large base takes long to save.
const MAX_LOG_COMMITS: u64 = 200;
const BYTES_A_COMMIT: u64 = 50_000;

const MAGIC: [u8; 8] = *b"\x8ccrnlog\n";
const HEADER: usize = 12;

/// Why a journal cannot be written or read.
#[derive(Debug, thiserror::Error)]
pub enum JournalError {
    /// A file operation failed.
    #[error("{}: {doing}: {source}", path.display())]
    Io {
        /// Which file or folder.
        path: PathBuf,
        /// What was being done.
        doing: &'static str,
        /// The system's error.
        source: io::Error,
    },
    /// A log of another release.
    #[error("{}: it has format {found}, this program has format {expected}", path.display())]
    Version {
        /// The file.
        path: PathBuf,
        /// Its format.
        found: u32,
        /// That of this program.
        expected: u32,
    },
    /// The base cannot be saved or read.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// The writing end.
pub struct JournalWriter {
    folder: PathBuf,
    log: File,
    path: PathBuf,
    bytes: u64,
    commits: u64,
    /// The version with which this log begins.
    version: u64,
    base_bytes: u64,
    base: Option<JoinHandle<Result<u64, JournalError>>>,
}

/// A map as it was a moment ago.
pub struct Recovered {
    /// The base with all commits applied.
    pub file: MapFile,
    /// How many commits were applied.
    pub commits: usize,
    /// The version with which the last log begins, its file, and how many of its bytes are whole.
    log: Option<(u64, PathBuf, u64)>,
    base_bytes: u64,
}

impl JournalWriter {
    /// Begins a journal with a base: that of an empty map, or a map that was opened.
    ///
    /// # Errors
    /// [`JournalError`] when the files cannot be written.
    pub fn begin(folder: &Path, base: &MapFile) -> Result<Self, JournalError> {
        let version = base.snapshot.version();
        let base_bytes = base.save(&base_path(folder, version))?;
        let (log, path) = new_log(folder, version)?;
        Ok(Self {
            folder: folder.to_owned(),
            log,
            path,
            bytes: HEADER as u64,
            commits: 0,
            version,
            base_bytes,
            base: None,
        })
    }

    /// Goes on with a journal that was recovered: what is not whole at its end is cut off.
    ///
    /// # Errors
    /// [`JournalError`] when the files cannot be written.
    pub fn resume(folder: &Path, from: &Recovered) -> Result<Self, JournalError> {
        let Some((version, path, whole)) = &from.log else { return Self::begin(folder, &from.file) };
        let open = || -> io::Result<File> {
            let mut log = File::options().write(true).open(path)?;
            log.set_len(*whole)?;
            log.seek(SeekFrom::End(0))?;
            Ok(log)
        };
        let log = open().map_err(failed(path, "continue"))?;
        Ok(Self {
            folder: folder.to_owned(),
            log,
            path: path.clone(),
            bytes: *whole,
            commits: from.commits as u64,
            version: *version,
            base_bytes: from.base_bytes,
            base: None,
        })
    }

    /// Appends a commit.
    ///
    /// # Errors
    /// [`JournalError`] when it cannot be written, as with a full disk.
    pub fn append(&mut self, commit: &Published) -> Result<(), JournalError> {
        let bytes = encode_commit(commit);
        let mut record = Vec::with_capacity(8 + bytes.len());
        record.extend((bytes.len() as u32).to_le_bytes());
        record.extend(crc32fast::hash(&bytes).to_le_bytes());
        record.extend(bytes);
        self.log.write_all(&record).map_err(failed(&self.path, "append"))?;
        self.bytes += record.len() as u64;
        self.commits += 1;
        Ok(())
    }

    /// Whether the log is so long that [`JournalWriter::rebase`] is due.
    pub fn is_long(&self) -> bool {
        let many = MAX_LOG_COMMITS + self.base_bytes / BYTES_A_COMMIT;
        (self.bytes > MAX_LOG_BYTES || self.commits > many) && self.is_complete()
    }

    /// Whether the base of the last [`JournalWriter::rebase`] is saved.
    pub fn is_complete(&self) -> bool {
        self.base.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Saves this map, whose commits have all been appended, as the new base, on a thread.
    ///
    /// # Errors
    /// [`JournalError`] when the new log cannot be made, or the base before could not be saved.
    pub fn rebase(&mut self, map: MapFile) -> Result<(), JournalError> {
        if let Some(Ok(result)) = self.base.take().map(JoinHandle::join) {
            self.base_bytes = result?;
        }
        let version = map.snapshot.version();
        let kept = std::mem::replace(&mut self.version, version);
        (self.log, self.path) = new_log(&self.folder, version)?;
        (self.bytes, self.commits) = (HEADER as u64, 0);
        let folder = self.folder.clone();
        let save = move || {
            let bytes = map.save(&base_path(&folder, version))?;
            for (older, path) in versions(&folder)? {
                if older < version && (is_base(&path) || older != kept) {
                    fs::remove_file(&path).map_err(failed(&path, "remove"))?;
                }
            }
            Ok(bytes)
        };
        let spawned = std::thread::Builder::new().name("cairn-base".into()).spawn(save);
        self.base = Some(spawned.map_err(failed(&self.folder, "start a thread"))?);
        Ok(())
    }
}

/// The map of a folder as it was a moment ago; `None` where there is none yet.
///
/// # Errors
/// [`JournalError`] when the files cannot be read, or are of another release. A commit that is not whole is the end, not an
/// error.
pub fn recover(folder: &Path) -> Result<Option<Recovered>, JournalError> {
    let files = versions(folder)?;
    let base = files.iter().rev().find(|(_, path)| is_base(path));
    let Some((begins, base)) = base else { return Ok(None) };
    let mut file = MapFile::load(base)?;
    let base_bytes = fs::metadata(base).map_err(failed(base, "read"))?.len();
    let (mut commits, mut last) = (0, None);
    let logs: Vec<_> = files.iter().filter(|(_, path)| !is_base(path)).collect();
    for (n, (version, path)) in logs.iter().enumerate() {
        // All of it is in the base: the next log begins no later than that.
        if logs.get(n + 1).is_some_and(|(next, _)| next <= begins) {
            continue;
        }
        let bytes = fs::read(path).map_err(failed(path, "read"))?;
        let Some(mut at) = check(path, &bytes)? else { continue };
        while let Some((record, next)) = record(&bytes, at) {
            let octaves = file.snapshot.octaves();
            let Ok(commit) = decode_commit(record, &file.about.camera, octaves) else { break };
            if commit.version > file.snapshot.version() {
                let Some(snapshot) = applied(&file.snapshot, &commit) else { break };
                file.snapshot = snapshot;
                commits += 1;
            }
            at = next;
        }
        last = Some((*version, path.clone(), at as u64));
    }
    Ok(Some(Recovered { file, commits, log: last, base_bytes }))
}

/// Removes the journal of a folder.
///
/// # Errors
/// [`JournalError`] when a file cannot be removed.
pub fn remove(folder: &Path) -> Result<(), JournalError> {
    for (_, path) in versions(folder)? {
        fs::remove_file(&path).map_err(failed(&path, "remove"))?;
    }
    Ok(())
}

/// The map after a commit; `None` when it is not the next one.
pub fn applied(snapshot: &Snapshot, commit: &Published) -> Option<Snapshot> {
    if commit.version != snapshot.version() + 1 {
        return None;
    }
    let changes = commit.changes.clone();
    let (next, applied) = snapshot.apply(&ChangeSet { base: snapshot.version(), changes });
    (applied.dropped == 0).then_some(next)
}

fn base_path(folder: &Path, version: u64) -> PathBuf {
    folder.join(format!("map-{version:012}.cairn"))
}

fn is_base(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "cairn")
}

fn new_log(folder: &Path, version: u64) -> Result<(File, PathBuf), JournalError> {
    let path = folder.join(format!("changes-{version:012}.log"));
    let mut log = File::create(&path).map_err(failed(&path, "create"))?;
    let mut header = MAGIC.to_vec();
    header.extend(COMMIT_VERSION.to_le_bytes());
    log.write_all(&header).map_err(failed(&path, "write"))?;
    Ok((log, path))
}

/// Bases and logs with the version in their name, in order.
fn versions(folder: &Path) -> Result<Vec<(u64, PathBuf)>, JournalError> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(failed(folder, "list"))? {
        let path = entry.map_err(failed(folder, "list"))?.path();
        let name = path.file_name().and_then(|n| n.to_str()).unwrap_or_default();
        let base = name.strip_prefix("map-").and_then(|n| n.strip_suffix(".cairn"));
        let log = name.strip_prefix("changes-").and_then(|n| n.strip_suffix(".log"));
        if let Some(version) = base.or(log).and_then(|n| n.parse().ok()) {
            found.push((version, path));
        }
    }
    found.sort();
    Ok(found)
}

/// Where the records of a log begin; `None` where the writer was killed before the header was whole.
fn check(path: &Path, bytes: &[u8]) -> Result<Option<usize>, JournalError> {
    let Some(format) = bytes.get(8..HEADER).filter(|_| bytes[..8] == MAGIC) else { return Ok(None) };
    match u32::from_le_bytes(std::array::from_fn(|i| format[i])) {
        COMMIT_VERSION => Ok(Some(HEADER)),
        found => Err(JournalError::Version { path: path.to_owned(), found, expected: COMMIT_VERSION }),
    }
}

/// The record at a place of a log, and the place of the next; `None` where it is not whole.
pub(crate) fn record(bytes: &[u8], at: usize) -> Option<(&[u8], usize)> {
    let (length, rest) = bytes.get(at..)?.split_first_chunk::<4>()?;
    let (crc, rest) = rest.split_first_chunk::<4>()?;
    let length = u32::from_le_bytes(*length) as usize;
    let record = rest.get(..length)?;
    (crc32fast::hash(record) == u32::from_le_bytes(*crc)).then_some((record, at + 8 + length))
}

pub(crate) fn failed(path: &Path, doing: &'static str) -> impl Fn(io::Error) -> JournalError {
    let path = path.to_owned();
    move |source| JournalError::Io { path: path.clone(), doing, source }
}
