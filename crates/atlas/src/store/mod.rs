//! Saved maps: one file for all maps of an atlas, with whatever data is attached.
//!
//! A file is written completely or not at all (`atomic.rs`), in named parts that are compressed and
//! checksummed (`container.rs`), each a set of columns (`wire.rs`). [`MapFile::read`] accepts any bytes: an
//! invalid map is an error that names the part, never a panic, and no length in the file is trusted before it
//! is compared with the bytes available. The same map always gives the same bytes.

mod about;
mod atomic;
mod container;
mod decode;
mod encode;
mod error;
mod wire;

pub use about::{About, sensor_name};
pub use container::PartInfo;
pub use error::StoreError;

use crate::Snapshot;
use container::Parts;
use std::collections::BTreeMap;
use std::io::{BufWriter, Cursor, Seek, SeekFrom};
use std::path::Path;

/// The format version that is written; versions from 1 to this are read.
pub const VERSION: u32 = 3;
/// Prefix of the names of attached parts, which mean nothing to the map.
const ATTACHED: &str = "attached/";

/// The content of a file: the maps, how they were made, and attached data.
#[derive(Clone, Debug)]
pub struct MapFile {
    /// The snapshot with all its maps.
    pub snapshot: Snapshot,
    /// How it was made.
    pub about: About,
    /// Attached data by name, recorded routes for example; kept as they are.
    pub attached: BTreeMap<String, Vec<u8>>,
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

impl MapFile {
    /// Reads a map from the bytes of a file. The result satisfies all invariants ([`Snapshot::check`]).
    ///
    /// # Errors
    ///
    /// [`StoreError`] naming the damaged or invalid part, or the unknown version.
    pub fn read(bytes: &[u8]) -> Result<Self, StoreError> {
        decode::read(&Parts::open(bytes, VERSION)?)
    }

    /// Loads a file.
    ///
    /// # Errors
    ///
    /// As [`MapFile::read`], or when the file cannot be read.
    pub fn load(path: &Path) -> Result<Self, StoreError> {
        let bytes = std::fs::read(path).map_err(StoreError::file(path, "cannot read"))?;
        Self::read(&bytes)
    }

    /// The bytes of the file.
    ///
    /// # Errors
    ///
    /// [`StoreError::Unfit`] when a name or a part cannot be stored.
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
