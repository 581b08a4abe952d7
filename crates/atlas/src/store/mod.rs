//! Maps on disk: one file for a whole map, with whatever else hangs on it.
//!
//! A file is written whole or not at all (`atomic.rs`), in named parts that are compressed and checksummed
//! (`container.rs`), each a set of columns (`wire.rs`). [`MapFile::read`] takes any bytes: what is no sound map is an
//! error that names the part, never a panic, and no length in the file is believed before it is compared with the bytes
//! there are. The same map always gives the same bytes.

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
/// What the names of parts begin with that hang on the map and mean nothing to it.
const ATTACHED: &str = "attached/";

/// What a file holds: a map, what it was made with, and what hangs on it.
#[derive(Clone, Debug)]
pub struct MapFile {
    /// The map with all its worlds.
    pub snapshot: Snapshot,
    /// What it was made with.
    pub about: About,
    /// Bytes of others by name, recorded ways for one; kept as they are.
    pub attached: BTreeMap<String, Vec<u8>>,
}

/// Looks at each part of a file by itself, also of one that is cut off or damaged: what the table says of it, and what is
/// wrong with it. An error when not even the table can be read.
pub fn inspect(bytes: &[u8]) -> Result<Vec<(PartInfo, Option<StoreError>)>, StoreError> {
    Ok(Parts::find(bytes, VERSION)?.0.inspected())
}

/// What a file says of itself without being unpacked.
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
    /// Reads header and table; the parts are not looked at, only that the file is as long as they are together.
    pub fn read(bytes: &[u8]) -> Result<Self, StoreError> {
        let parts = Parts::open(bytes, VERSION)?;
        Ok(Self { version: parts.version, bytes: bytes.len() as u64, parts: parts.infos() })
    }
}

impl MapFile {
    /// Reads a map from the bytes of a file. What comes back obeys all rules of a map ([`Snapshot::check`]).
    pub fn read(bytes: &[u8]) -> Result<Self, StoreError> {
        decode::read(&Parts::open(bytes, VERSION)?)
    }

    /// Opens a file.
    pub fn load(path: &Path) -> Result<Self, StoreError> {
        let bytes = std::fs::read(path).map_err(StoreError::file(path, "cannot read"))?;
        Self::read(&bytes)
    }

    /// The bytes of a file.
    pub fn write(&self) -> Result<Vec<u8>, StoreError> {
        let mut out = Cursor::new(Vec::new());
        encode::write(self, &mut out)?;
        Ok(out.into_inner())
    }

    /// Writes a file, whole or not at all: on any error what was there before is still there. Returns its bytes.
    pub fn save(&self, path: &Path) -> Result<u64, StoreError> {
        let failed = || StoreError::file(path, "cannot write");
        atomic::write_whole(path, |file| {
            let mut out = BufWriter::with_capacity(1 << 18, file);
            encode::write(self, &mut out)?;
            out.seek(SeekFrom::End(0)).map_err(failed())
        })
    }
}
