//! The store as steps see it: blobs by digest, results by key, and how many bytes went either way.

use crate::task::{Blob, Result as Found};
use crate::{Digest, FleetError, Store, open};
use std::cell::Cell;

/// The store of a task, with what it cost.
pub(crate) struct Shelf {
    store: Box<dyn Store>,
    read: Cell<u64>,
    written: Cell<u64>,
}

impl Shelf {
    pub(crate) fn open(address: &str) -> Result<Self, FleetError> {
        Ok(Self { store: open(address)?, read: Cell::new(0), written: Cell::new(0) })
    }

    pub(crate) fn store(&self) -> &dyn Store {
        &*self.store
    }

    /// Bytes read so far.
    pub(crate) fn read_bytes(&self) -> u64 {
        self.read.get()
    }

    /// Bytes written so far.
    pub(crate) fn written_bytes(&self) -> u64 {
        self.written.get()
    }

    /// The content of a blob.
    pub(crate) fn blob(&self, digest: Digest) -> Result<Vec<u8>, FleetError> {
        let name = blob_name(digest);
        let bytes = self.store.get(&name)?.ok_or_else(|| {
            FleetError::new(&name, "it is not in the store", "delete steps/ of the store and build again")
        })?;
        self.read.set(self.read.get() + bytes.len() as u64);
        if Digest::of(&bytes) != digest {
            return Err(FleetError::damaged(name, "its content is not what its name says"));
        }
        Ok(bytes)
    }

    /// Keeps a content.
    pub(crate) fn keep(&self, bytes: &[u8]) -> Result<Blob, FleetError> {
        let blob = Blob { digest: Digest::of(bytes), bytes: bytes.len() as u64 };
        if self.store.put_new(&blob_name(blob.digest), bytes)? {
            self.written.set(self.written.get() + blob.bytes);
        }
        Ok(blob)
    }

    pub(crate) fn done(&self, key: Digest) -> Result<Option<Found>, FleetError> {
        let name = step_name(key);
        let Some(bytes) = self.store.get(&name)? else { return Ok(None) };
        self.read.set(self.read.get() + bytes.len() as u64);
        serde_json::from_slice(&bytes).map(Some).map_err(|e| FleetError::damaged(name, e))
    }

    pub(crate) fn note(&self, key: Digest, found: &Found) -> Result<(), FleetError> {
        let bytes = serde_json::to_vec(found).map_err(|e| FleetError::new("result", e, "report this"))?;
        if self.store.put_new(&step_name(key), &bytes)? {
            self.written.set(self.written.get() + bytes.len() as u64);
        }
        Ok(())
    }
}

/// The name of a blob in the store.
pub(crate) fn blob_name(digest: Digest) -> String {
    let text = digest.to_string();
    format!("blobs/{}/{text}", &text[..2])
}

fn step_name(key: Digest) -> String {
    let text = key.to_string();
    format!("steps/{}/{text}.json", &text[..2])
}
