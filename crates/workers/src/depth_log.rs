//! The depth of key frames beside the journal of the map: what surfaces are made of, in a file that outlives who writes it.
//!
//! SLAM appends the depth of a key frame before it appends the commit that adds it, so whoever reads the journal first and this
//! file afterwards has the depth of every key frame that it knows. Surfaces are made by another process, which keeps nothing:
//! one that is started again reads all of it.
//!
//! ```text
//! depth.log      magic 8 | format u32 | generation u32, then for each: length u32 | crc32 u32 | key frame u32 | stamp i64 |
//!                bytes u32 | compressed depth | compressed gray image, which may be empty
//! ```
//!
//! The last record of a key frame counts. One without an image says that what was said before is void: with the time of the key frame, that its
//! depth is superfluous by now ([`cairn_engine::Views`]); with no time, that it is of no key frame, since SLAM died before it
//! had committed it, and its number may come again.
//!
//! Once most of the file is void, and [`MOST_VOID`] bytes of it, it is written again without that, as the next generation. Who reads it finds out
//! by the number, and is told that what is missing in it is void. So the file is at most about twice as long as what counts in it, and what
//! comes while it is written again, by a thread of its own.

use crate::journal::{JournalError, failed, record};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_dense::{PackedDepth, PackedGray};
use cairn_sensor::Stamp;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

const MAGIC: [u8; 8] = *b"\x8ccrndpt\n";
/// Of this file; another layout gets another number.
const FORMAT: u32 = 2;
const HEADER: usize = 16;
/// Void bytes that are not worth to be written again without them.
pub const MOST_VOID: u64 = 8 << 20;

/// The depth of a key frame.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyFrameDepth {
    /// The key frame.
    pub id: KeyFrameId,
    /// Its stamp; none where it is of no key frame.
    pub stamp: Stamp,
    /// The compressed image; empty where what was said of this key frame before is void.
    pub packed: Arc<[u8]>,
    /// What the same pixels look like; empty where surfaces have no colours.
    pub gray: Arc<[u8]>,
}

impl KeyFrameDepth {
    /// Whether what was said of this key frame before is void.
    pub fn is_void(&self) -> bool {
        self.packed.is_empty()
    }

    /// Whether it is superfluous: its key frame is in the map, or was.
    pub fn is_spare(&self) -> bool {
        self.is_void() && self.stamp != NONE
    }
}

/// The stamp of what is of no key frame.
const NONE: Stamp = Stamp(i64::MIN);

/// The writing end.
#[derive(Debug)]
pub struct DepthWriter {
    log: File,
    path: PathBuf,
    generation: u32,
    /// What counts: stamp and bytes of the record of each key frame.
    kept: BTreeMap<KeyFrameId, (Stamp, u64)>,
    bytes: u64,
    /// The next generation, while it is written.
    again: Option<Again>,
}

/// The file written again from what it was until so many bytes.
#[derive(Debug)]
struct Again {
    thread: JoinHandle<std::io::Result<(File, u64)>>,
    until: u64,
}

impl DepthWriter {
    /// Begins the file of a folder, or goes on with the one that is there, for a map that is this by now: what is not whole at its
    /// end is cut off, and depth of key frames that this map does not know is void.
    ///
    /// # Errors
    /// [`JournalError`] when the file cannot be read or written, or is of another release.
    pub fn open(folder: &Path, map: &Snapshot) -> Result<Self, JournalError> {
        let path = path_in(folder);
        let mut tail = DepthTail::new(folder);
        let found = tail.follow()?;
        let open = || -> std::io::Result<File> {
            let mut log = File::options().write(true).create(true).truncate(false).open(&path)?;
            log.set_len(tail.at)?;
            log.seek(SeekFrom::End(0))?;
            if tail.at == 0 {
                log.write_all(&header(0))?;
            }
            Ok(log)
        };
        let log = open().map_err(failed(&path, "continue"))?;
        let (generation, bytes) = (tail.generation, tail.at.max(HEADER as u64));
        let mut writer = Self { log, path, generation, kept: BTreeMap::new(), bytes, again: None };
        for d in &found {
            writer.count(d.id, d.stamp, [&d.packed, &d.gray].map(|part| part.len()));
        }
        let ids: Vec<KeyFrameId> = writer.kept.keys().copied().collect();
        for id in ids.into_iter().filter(|id| map.surviving_ancestor(*id).is_none()) {
            writer.write(id, NONE, &[], &[])?;
        }
        Ok(writer)
    }

    /// The key frames whose depth counts.
    pub fn key_frames(&self) -> impl Iterator<Item = KeyFrameId> {
        self.kept.keys().copied()
    }

    /// Appends the depth of a key frame.
    ///
    /// # Errors
    /// [`JournalError`] when it cannot be written, as with a full disk.
    pub fn append(
        &mut self,
        id: KeyFrameId,
        stamp: Stamp,
        depth: &PackedDepth,
        gray: Option<&PackedGray>,
    ) -> Result<(), JournalError> {
        self.write(id, stamp, depth.as_bytes(), gray.map_or(&[], |gray| gray.as_bytes()))
    }

    /// The depth of a key frame is superfluous; one that is not here changes nothing.
    ///
    /// # Errors
    /// [`JournalError`] when it cannot be written.
    pub fn drop_spare(&mut self, id: KeyFrameId) -> Result<(), JournalError> {
        let Some((stamp, _)) = self.kept.get(&id).copied() else { return Ok(()) };
        self.write(id, stamp, &[], &[])?;
        let counts: u64 = self.kept.values().map(|(_, bytes)| bytes).sum();
        if self.settle() && self.bytes.saturating_sub(counts) > counts.max(MOST_VOID) {
            self.write_again();
        }
        Ok(())
    }

    fn write(&mut self, id: KeyFrameId, stamp: Stamp, depth: &[u8], gray: &[u8]) -> Result<(), JournalError> {
        let (number, length) = ((id.index() as u32).to_le_bytes(), (depth.len() as u32).to_le_bytes());
        let body = [&number[..], &stamp.0.to_le_bytes(), &length, depth, gray].concat();
        let mut record = Vec::with_capacity(8 + body.len());
        record.extend((body.len() as u32).to_le_bytes());
        record.extend(crc32fast::hash(&body).to_le_bytes());
        record.extend(body);
        self.log.write_all(&record).map_err(failed(&self.path, "append"))?;
        self.bytes += record.len() as u64;
        self.count(id, stamp, [depth.len(), gray.len()]);
        Ok(())
    }

    fn count(&mut self, id: KeyFrameId, stamp: Stamp, [depth, gray]: [usize; 2]) {
        match depth {
            0 => self.kept.remove(&id),
            _ => self.kept.insert(id, (stamp, (RECORD + depth + gray) as u64)),
        };
    }

    /// Begins to write the file again without what is void, on a thread of its own: SLAM does not wait for it. One that dies meanwhile
    /// leaves the file as it was.
    fn write_again(&mut self) {
        let (path, next, until) = (self.path.clone(), next_in(&self.path), self.bytes);
        let generation = self.generation.wrapping_add(1);
        let stamps: BTreeMap<KeyFrameId, Stamp> =
            self.kept.iter().map(|(id, (stamp, _))| (*id, *stamp)).collect();
        let thread = std::thread::Builder::new().name("cairn-depth-log".into());
        let thread = thread.spawn(move || {
            let old = read(&path, 0, until)?;
            let mut all = header(generation).to_vec();
            let mut at = HEADER;
            while let Some((body, end)) = record(&old, at) {
                let counts = |d: &KeyFrameDepth| !d.is_void() && stamps.get(&d.id) == Some(&d.stamp);
                if parse(body).is_some_and(|d| counts(&d)) {
                    all.extend(&old[at..end]);
                }
                at = end;
            }
            let mut log = File::create(&next)?;
            log.write_all(&all)?;
            Ok((log, all.len() as u64))
        });
        // Without a thread the old file goes on.
        self.again = thread.ok().map(|thread| Again { thread, until });
    }

    /// Takes the file that was written again, where it is done: what came meanwhile is added. Returns whether none is being written.
    pub fn settle(&mut self) -> bool {
        let Some(Again { thread, until }) = self.again.take_if(|again| again.thread.is_finished()) else {
            return self.again.is_none();
        };
        let next = next_in(&self.path);
        let take = |made: std::io::Result<(File, u64)>| -> std::io::Result<(File, u64)> {
            let (mut log, bytes) = made?;
            let since = read(&self.path, until, self.bytes)?;
            log.write_all(&since)?;
            std::fs::rename(&next, &self.path)?;
            Ok((log, bytes + since.len() as u64))
        };
        // Without room for both the old one goes on, and is told when it finds none itself.
        match thread.join().map(take) {
            Ok(Ok((log, bytes))) => {
                (self.log, self.bytes) = (log, bytes);
                self.generation = self.generation.wrapping_add(1);
            }
            _ => drop(std::fs::remove_file(&next)),
        }
        true
    }
}

impl Drop for DepthWriter {
    /// Nobody else may write the next generation meanwhile.
    fn drop(&mut self) {
        if let Some(again) = self.again.take() {
            let _ = again.thread.join();
            let _ = std::fs::remove_file(next_in(&self.path));
        }
    }
}

/// A part of a file.
fn read(path: &Path, from: u64, until: u64) -> std::io::Result<Vec<u8>> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(from))?;
    let mut bytes = Vec::new();
    file.take(until - from).read_to_end(&mut bytes)?;
    Ok(bytes)
}

fn header(generation: u32) -> [u8; HEADER] {
    let mut header = [0; HEADER];
    header[..8].copy_from_slice(&MAGIC);
    header[8..12].copy_from_slice(&FORMAT.to_le_bytes());
    header[12..].copy_from_slice(&generation.to_le_bytes());
    header
}

/// The reading end, from the beginning.
#[derive(Debug)]
pub struct DepthTail {
    path: PathBuf,
    generation: u32,
    /// Bytes that were read, all of them whole.
    at: u64,
    /// What counts of them.
    known: BTreeMap<KeyFrameId, Stamp>,
}

impl DepthTail {
    /// Of the file of a folder, which may not be there yet.
    pub fn new(folder: &Path) -> Self {
        Self { path: path_in(folder), generation: 0, at: 0, known: BTreeMap::new() }
    }

    /// What was written since, in order. A record that is not whole yet is left for the next time.
    ///
    /// # Errors
    /// [`JournalError`] when the file cannot be read, or is of another release.
    pub fn follow(&mut self) -> Result<Vec<KeyFrameDepth>, JournalError> {
        let failed = failed(&self.path, "read");
        let mut log = match File::open(&self.path) {
            Ok(log) => log,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
            Err(e) => return Err(failed(e)),
        };
        let mut header = Vec::new();
        (&mut log).take(HEADER as u64).read_to_end(&mut header).map_err(&failed)?;
        let Some(header) = header.first_chunk::<HEADER>() else { return Ok(Vec::new()) };
        let [format, generation] =
            [8, 12].map(|i| u32::from_le_bytes(std::array::from_fn(|k| header[i + k])));
        if header[..8] != MAGIC || format != FORMAT {
            let path = self.path.clone();
            return Err(JournalError::Version { path, found: format, expected: FORMAT });
        }
        let is_next = self.at > 0 && generation != self.generation;
        if self.at == 0 || is_next {
            (self.generation, self.at) = (generation, HEADER as u64);
        }
        let mut bytes = Vec::new();
        log.seek(SeekFrom::Start(self.at)).and_then(|_| log.read_to_end(&mut bytes)).map_err(&failed)?;
        let (mut at, mut found) = (0, Vec::new());
        while let Some((body, next)) = record(&bytes, at) {
            // Not whole in itself, although its checksum is right: another program's.
            let Some(depth) = parse(body) else { break };
            found.push(depth);
            at = next;
        }
        self.at += at as u64;
        let before = if is_next { std::mem::take(&mut self.known) } else { BTreeMap::new() };
        for d in &found {
            match d.is_void() {
                true => self.known.remove(&d.id),
                false => self.known.insert(d.id, d.stamp),
            };
        }
        // Of what was known before, only what is missing by now is told.
        found.retain(|d| before.get(&d.id) != Some(&d.stamp));
        let missing = before.into_iter().filter(|(id, stamp)| self.known.get(id) != Some(stamp));
        let void = missing.map(|(id, stamp)| KeyFrameDepth { id, stamp, packed: [].into(), gray: [].into() });
        Ok(void.chain(found).collect())
    }
}

fn parse(body: &[u8]) -> Option<KeyFrameDepth> {
    let (id, rest) = body.split_first_chunk::<4>()?;
    let (stamp, rest) = rest.split_first_chunk::<8>()?;
    let (length, rest) = rest.split_first_chunk::<4>()?;
    let (packed, gray) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
    Some(KeyFrameDepth {
        id: KeyFrameId::from_index(u32::from_le_bytes(*id) as usize)?,
        stamp: Stamp(i64::from_le_bytes(*stamp)),
        packed: packed.into(),
        gray: gray.into(),
    })
}

/// Bytes of a record without its images.
const RECORD: usize = 8 + 4 + 8 + 4;

/// Removes the file of a folder.
///
/// # Errors
/// [`JournalError`] when it is there and cannot be removed.
pub fn remove(folder: &Path) -> Result<(), JournalError> {
    let path = path_in(folder);
    match std::fs::remove_file(&path) {
        Err(e) if e.kind() != ErrorKind::NotFound => Err(failed(&path, "remove")(e)),
        _ => Ok(()),
    }
}

fn path_in(folder: &Path) -> PathBuf {
    folder.join("depth.log")
}

/// Where the next generation of a file is written.
fn next_in(path: &Path) -> PathBuf {
    path.with_extension("next")
}
