//! Recordings below an address: their names, what their content is known by, and how they get onto this machine.

use crate::{Digest, FleetError, Listed, Store, open};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU32, Ordering};

static COUNT: AtomicU32 = AtomicU32::new(0);

/// A recording: what is below a name directly under the address, or the file of that name.
pub(crate) struct Recording {
    store: Box<dyn Store>,
    name: String,
    files: Vec<Listed>,
}

/// A recording on this machine; where it was fetched it is removed again at the end.
pub(crate) struct Here {
    pub(crate) path: PathBuf,
    /// Bytes that were fetched.
    pub(crate) fetched: u64,
    temporary: Option<PathBuf>,
}

impl Drop for Here {
    fn drop(&mut self) {
        if let Some(folder) = &self.temporary {
            // What cannot be removed is left to whoever cleans the folder of temporary files.
            let _ = std::fs::remove_dir_all(folder);
        }
    }
}

/// The names of all recordings.
pub(crate) fn names(address: &str) -> Result<Vec<String>, FleetError> {
    open(address)?.children("")
}

impl Recording {
    pub(crate) fn find(address: &str, name: &str) -> Result<Self, FleetError> {
        let store = open(address)?;
        let files = store.list(name)?;
        Ok(Self { store, name: name.to_owned(), files })
    }

    /// The digest of names and contents; where the store tells of each file what changes with its content (S3), of that in place
    /// of the content.
    pub(crate) fn digest(&self) -> Result<Digest, FleetError> {
        let mut parts = Vec::new();
        for file in &self.files {
            let content = match &file.tag {
                Some(tag) => Digest::of_parts([tag.as_bytes(), &file.bytes.to_le_bytes()]),
                None => Digest::of(&self.read(file)?),
            };
            // A single file is known by its kind and content, not by its name.
            let name = if file.name.is_empty() { self.name.rsplit('.').next() } else { Some(&*file.name) };
            parts.push(Digest::of_parts([name.unwrap_or_default().as_bytes(), &content.0]));
        }
        Ok(Digest::of_parts(parts.iter().map(|d| d.0.as_slice())))
    }

    fn read(&self, file: &Listed) -> Result<Vec<u8>, FleetError> {
        let name =
            if file.name.is_empty() { self.name.clone() } else { format!("{}/{}", self.name, file.name) };
        self.store
            .get(&name)?
            .ok_or_else(|| FleetError::new(name, "it went away meanwhile", "build again once all is there"))
    }

    /// Brings the recording onto this machine, unless it is there.
    pub(crate) fn here(&self) -> Result<Here, FleetError> {
        if let Some(path) = self.store.local(&self.name) {
            return Ok(Here { path, fetched: 0, temporary: None });
        }
        let id = (std::process::id(), COUNT.fetch_add(1, Ordering::Relaxed));
        let folder = std::env::temp_dir().join(format!("cairn-fleet-{}-{}", id.0, id.1));
        let path = folder.join(&self.name);
        let mut here = Here { path: path.clone(), fetched: 0, temporary: Some(folder) };
        for file in &self.files {
            let to = if file.name.is_empty() { path.clone() } else { path.join(&file.name) };
            let bytes = self.read(file)?;
            here.fetched += bytes.len() as u64;
            let parent = to.parent().unwrap_or(&path);
            std::fs::create_dir_all(parent).and_then(|()| std::fs::write(&to, bytes)).map_err(|e| {
                FleetError::new(
                    to.display().to_string(),
                    e,
                    "make room in the folder of temporary files (TMPDIR)",
                )
            })?;
        }
        Ok(here)
    }
}
