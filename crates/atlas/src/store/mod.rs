//! Saved maps: one file for all maps of an atlas, with whatever data is attached.
//!
//! A file is written completely or not at all (`atomic.rs`), in named parts that are compressed and
//! checksummed (`container.rs`), each a set of columns (`wire.rs`). [`MapFile::read`] accepts any bytes: an
//! invalid map is an error that names the part, never a panic, and no length in the file is trusted before it
//! is compared with the bytes available. The same map always gives the same bytes.

mod about;
mod atomic;
mod beside;
mod changes;
mod chunks;
mod container;
mod decode;
mod depth;
mod encode;
mod error;
mod in_file;
mod later;
mod layout;
pub mod pieces;
mod readings;
mod relative_poses;
mod scales;
mod virtual_baseline;
mod wire;

pub use about::{About, CameraMismatch, sensor_name};
pub use beside::{HAS_THREADS, process_id};
pub use changes::{COMMIT_VERSION, decode_commit, encode_commit};
pub use container::{MAGIC, PartInfo};
pub use depth::{DEPTH_PREFIX, DepthPart, Place, SavedDepth};
pub use error::StoreError;
pub use layout::{MapFile, VERSION};

use beside::both;
use container::Parts;
use decode::Damage;
use in_file::Places;
use later::LaterFeatures;
use layout::{FEATURES, SHOWN};
use std::io::{BufWriter, Cursor, Read, Seek, SeekFrom};
use std::path::Path;
use std::sync::Arc;

/// Largest file that is read as a map.
const MAX_BYTES: u64 = 64 << 30;

/// Which length a file may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// That which its header says.
    AsPromised,
    /// Any: for looking into damaged files.
    Any,
}

/// The bytes of a map file. Of a file that does not begin as a map nothing more is read than its header.
///
/// # Errors
///
/// [`StoreError`] when the file cannot be read, is no map, or has another length than it should.
pub fn read_file(path: &Path, length: Length) -> Result<Vec<u8>, StoreError> {
    let failed = || StoreError::file(path, "cannot read");
    let mut file = cairn_files::open(path, MAX_BYTES).map_err(failed())?;
    let bytes = file.metadata().map_err(failed())?.len();
    let mut start = Vec::new();
    (&mut file).take(container::HEADER as u64).read_to_end(&mut start).map_err(failed())?;
    let promised = container::promised_length(&start, VERSION);
    match (promised, length) {
        (Err(e), Length::AsPromised) => return Err(e),
        (Err(e @ StoreError::Foreign(_)), Length::Any) => return Err(e),
        (Ok(promised), Length::AsPromised) if promised != bytes => {
            let why = format!("it promises {promised} bytes, there are {bytes}");
            return Err(StoreError::part("header", why));
        }
        _ => {}
    }
    start.reserve_exact(usize::try_from(bytes).unwrap_or(0).saturating_sub(start.len()));
    file.take(MAX_BYTES).read_to_end(&mut start).map_err(failed())?;
    Ok(start)
}

/// Checks each part of a file by itself, also of one that is truncated or damaged: its row in the table, and
/// what is wrong with it.
///
/// # Errors
///
/// [`StoreError`] when not even the table can be read.
pub fn inspect(bytes: &[u8]) -> Result<Vec<(PartInfo, Option<StoreError>)>, StoreError> {
    Ok(Parts::find(bytes, VERSION)?.0.inspected())
}

/// The table of contents of a file, read without unpacking the parts.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    /// Format version.
    pub version: u32,
    /// Bytes of the file.
    pub bytes: u64,
    /// The parts in their order.
    pub parts: Vec<PartInfo>,
}

impl Table {
    /// Reads header and table; the parts are not checked, only that the length of the file is right.
    ///
    /// # Errors
    ///
    /// [`StoreError`] when header or table are damaged, or the length differs.
    pub fn read(bytes: &[u8]) -> Result<Self, StoreError> {
        let parts = Parts::open(bytes, VERSION)?;
        Ok(Self { version: parts.version, bytes: bytes.len() as u64, parts: parts.infos() })
    }
}

/// Opens a file without its features, if it can be.
fn open(path: &Path) -> Result<Option<MapFile>, StoreError> {
    let failed = || StoreError::file(path, "cannot read");
    let named = |e| match e {
        StoreError::File { doing, source, .. } => StoreError::File { path: path.to_owned(), doing, source },
        other => other,
    };
    let mut file = cairn_files::open(path, MAX_BYTES).map_err(failed())?;
    let bytes = file.metadata().map_err(failed())?.len();
    let places = Places::read(&mut file, bytes, VERSION).map_err(named)?;
    if places.entries.iter().all(|(entry, _)| entry.name != SHOWN) {
        return Ok(None);
    }
    let later = Arc::new(LaterFeatures::new(file, &places));
    let mut first = Vec::new();
    for part in places.entries.iter().filter(|(entry, _)| !entry.name.starts_with(FEATURES)) {
        let mut stored = Vec::new();
        later.stored(part, &mut stored).map_err(failed())?;
        first.push((&part.0, stored));
    }
    let parts = places.parts(first.iter().map(|(entry, stored)| (*entry, &stored[..])));
    let read = || decode::read(&parts, &mut Damage::Refuse, Some(&later));
    let (opened, checked) = both(read, || later.check());
    checked.unwrap_or_else(|| Err(StoreError::part(FEATURES, "they cannot be checked"))).map_err(named)?;
    opened.map(Some).map_err(named)
}

impl MapFile {
    /// Reads a map from the bytes of a file. The result satisfies all invariants ([`crate::Snapshot::check`]).
    ///
    /// # Errors
    ///
    /// [`StoreError`] naming the damaged or invalid part, or the unknown version.
    pub fn read(bytes: &[u8]) -> Result<Self, StoreError> {
        decode::read(&Parts::open(bytes, VERSION)?, &mut Damage::Refuse, None)
    }

    /// Reads what is whole of a damaged or truncated map; also returns what was lost, one line each. Without features a
    /// key frame keeps its pose and shows nothing; words are computed again; landmarks that nothing shows any more, and
    /// attached data that is damaged, are left out. The result satisfies all invariants.
    ///
    /// # Errors
    ///
    /// [`StoreError`] when a part is damaged without which nothing is left: the table, key frames, landmarks, or how the
    /// map was made.
    pub fn salvage(bytes: &[u8]) -> Result<(Self, Vec<String>), StoreError> {
        let mut lost = Vec::new();
        let (parts, promised) = match Parts::find(bytes, VERSION) {
            Err(e @ StoreError::Part { .. }) => {
                let found =
                    Parts::scan(bytes, VERSION).ok_or_else(|| StoreError::part("table", e.to_string()))?;
                lost.push(format!("{e}: the parts were found without it"));
                let length = found.bytes;
                (found, length)
            }
            found => found?,
        };
        if promised != parts.bytes {
            lost.push(format!("the header promises {promised} bytes, there are {}", parts.bytes));
        }
        let file = decode::read(&parts, &mut Damage::LeaveOut(&mut lost), None)?;
        Ok((file, lost))
    }

    /// Loads a file. What is no map, and a map that is not as long as it says, is refused before it is read. Features stay in
    /// the file, which is held open, until somebody looks at a key frame; where it was written without what that needs, it is
    /// read whole.
    ///
    /// # Errors
    ///
    /// As [`MapFile::read`], or when the file cannot be read.
    pub fn load(path: &Path) -> Result<Self, StoreError> {
        match open(path)? {
            Some(file) => Ok(file),
            None => Self::read(&read_file(path, Length::AsPromised)?),
        }
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// [`StoreError::CombineError`] when a name or a part cannot be stored.
    pub fn write(&self) -> Result<Vec<u8>, StoreError> {
        let mut out = Cursor::new(Vec::new());
        encode::write(self, &mut out)?;
        Ok(out.into_inner())
    }

    /// Writes a file, completely or not at all: on any error the previous file is still there. Returns the
    /// file's size in bytes.
    ///
    /// # Errors
    ///
    /// As [`MapFile::write`], or when the file cannot be written.
    pub fn save(&self, path: &Path) -> Result<u64, StoreError> {
        let failed = || StoreError::file(path, "cannot write");
        atomic::write_whole(path, |file| {
            let mut out = BufWriter::with_capacity(1 << 18, file);
            encode::write(self, &mut out)?;
            out.seek(SeekFrom::End(0)).map_err(failed())
        })
    }
}
