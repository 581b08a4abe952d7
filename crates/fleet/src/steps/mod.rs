//! The steps: each reads blobs, writes blobs and returns what it found, the same to the byte wherever it runs.

mod map;
mod merge;
mod pairs;
mod publish;
mod tiles;
mod verify;

pub(crate) use map::map;
pub(crate) use merge::merge;
pub(crate) use pairs::{index, pairs};
pub(crate) use publish::publish;
pub(crate) use tiles::tiles;
pub(crate) use verify::verify;

use crate::shelf::Shelf;
use crate::{Digest, FleetError};
use cairn::atlas::store::MapFile;

/// A map of the store.
pub(crate) fn map_file(shelf: &Shelf, digest: Digest) -> Result<MapFile, FleetError> {
    MapFile::read(&shelf.blob(digest)?).map_err(|e| FleetError::damaged(digest.to_string(), e))
}

/// Bytes of a map to keep.
pub(crate) fn bytes_of(file: &MapFile) -> Result<Vec<u8>, FleetError> {
    file.write().map_err(|e| FleetError::new("map", e, "report this"))
}
