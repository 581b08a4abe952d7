//! The depth of key frames beside the journal of the map: what surfaces are made of, in a file that outlives who writes it.
//!
//! SLAM appends the depth of a key frame before it appends the commit that adds it, so whoever reads the journal first and this
//! file afterwards has the depth of every key frame that it knows. Surfaces are made by another process, which keeps nothing:
//! one that is started again reads all of it.
//!
//! ```text
//! depth.log      magic 8 | format u32, then for each: length u32 | crc32 u32 | key frame u32 | stamp i64 |
//!                bytes u32 | compressed depth | compressed gray image, which may be empty
//! ```
//!
//! The last record of a key frame counts. One without an image says that those before it are of no key frame: SLAM died before it
//! had committed it, and its number may come again.

use crate::journal::{JournalError, failed, record};
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_dense::{PackedDepth, PackedGray};
use cairn_sensor::Stamp;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const MAGIC: [u8; 8] = *b"\x8ccrndpt\n";
/// Of this file; another layout gets another number.
const FORMAT: u32 = 1;
const HEADER: usize = 12;

/// The depth of a key frame.
#[derive(Clone, Debug, PartialEq)]
pub struct KeyFrameDepth {
    /// The key frame.
    pub id: KeyFrameId,
    /// Its stamp.
    pub stamp: Stamp,
    /// The compressed image; empty where what was said of this key frame before is void.
    pub packed: Arc<[u8]>,
    /// What the same pixels look like; empty where surfaces have no colours.
    pub gray: Arc<[u8]>,
}

/// The writing end.
#[derive(Debug)]
pub struct DepthWriter {
    log: File,
    path: PathBuf,
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
                log.write_all(&[&MAGIC[..], &FORMAT.to_le_bytes()].concat())?;
            }
            Ok(log)
        };
        let mut writer = Self { log: open().map_err(failed(&path, "continue"))?, path };
        let last: BTreeMap<KeyFrameId, bool> = found.iter().map(|d| (d.id, d.packed.is_empty())).collect();
        for (id, _) in last.into_iter().filter(|(id, void)| !void && map.surviving_ancestor(*id).is_none()) {
            writer.write(id, Stamp::default(), &[], &[])?;
        }
        Ok(writer)
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

    fn write(&mut self, id: KeyFrameId, stamp: Stamp, depth: &[u8], gray: &[u8]) -> Result<(), JournalError> {
        let (id, length) = ((id.index() as u32).to_le_bytes(), (depth.len() as u32).to_le_bytes());
        let body = [&id[..], &stamp.0.to_le_bytes(), &length, depth, gray].concat();
        let mut record = Vec::with_capacity(8 + body.len());
        record.extend((body.len() as u32).to_le_bytes());
        record.extend(crc32fast::hash(&body).to_le_bytes());
        record.extend(body);
        self.log.write_all(&record).map_err(failed(&self.path, "append"))
    }
}

/// The reading end, from the beginning.
#[derive(Debug)]
pub struct DepthTail {
    path: PathBuf,
    /// Bytes that were read, all of them whole.
    at: u64,
}

impl DepthTail {
    /// Of the file of a folder, which may not be there yet.
    pub fn new(folder: &Path) -> Self {
        Self { path: path_in(folder), at: 0 }
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
        let mut bytes = Vec::new();
        log.seek(SeekFrom::Start(self.at)).and_then(|_| log.read_to_end(&mut bytes)).map_err(&failed)?;
        let mut at = 0;
        if self.at == 0 {
            let Some(header) = bytes.first_chunk::<HEADER>() else { return Ok(Vec::new()) };
            let format = u32::from_le_bytes([header[8], header[9], header[10], header[11]]);
            if header[..8] != MAGIC || format != FORMAT {
                let path = self.path.clone();
                return Err(JournalError::Version { path, found: format, expected: FORMAT });
            }
            at = HEADER;
        }
        let mut found = Vec::new();
        while let Some((body, next)) = record(&bytes, at) {
            // Not whole in itself, although its checksum is right: another program's.
            let Some(depth) = parse(body) else { break };
            found.push(depth);
            at = next;
        }
        self.at += at as u64;
        Ok(found)
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
