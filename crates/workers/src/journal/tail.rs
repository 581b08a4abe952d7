//! Follows a journal that another process writes.

use super::{HEADER, JournalError, applied, check, failed, record, recover, versions};
use cairn_atlas::store::{MapFile, decode_commit};
use cairn_atlas::{Published, Snapshot};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// The reading end: the map as far as the journal tells it.
pub struct Tail {
    folder: PathBuf,
    file: MapFile,
    log: PathBuf,
    at: u64,
}

impl Tail {
    /// The map so far; `None` while nothing is written.
    ///
    /// # Errors
    /// [`JournalError`] when the files cannot be read, or are of another release.
    pub fn open(folder: &Path) -> Result<Option<Self>, JournalError> {
        let recovered = recover(folder)?;
        Ok(recovered.and_then(|r| {
            let (_, log, at) = r.log?;
            Some(Self { folder: folder.to_owned(), file: r.file, log, at })
        }))
    }

    /// The map.
    pub fn map(&self) -> &Snapshot {
        &self.file.snapshot
    }

    /// The map with its provenance.
    pub fn file(&self) -> &MapFile {
        &self.file
    }

    /// Reads what was written since. A commit that is not whole yet is left for the next time.
    ///
    /// # Errors
    /// As [`Tail::open`].
    pub fn follow(&mut self) -> Result<(), JournalError> {
        self.follow_each(|_| ()).map(drop)
    }

    /// As [`Tail::follow`]; `then` is given each commit. False where the map is a later one by now without all commits up to it
    /// having been read: a newer base has replaced them.
    ///
    /// # Errors
    /// As [`Tail::open`].
    pub fn follow_each(&mut self, mut then: impl FnMut(Published)) -> Result<bool, JournalError> {
        loop {
            let Some(bytes) = self.written()? else { return self.begin_again() };
            let mut read = 0;
            while let Some((commit, next)) = record(&bytes, read) {
                let octaves = self.file.snapshot.octaves();
                let Ok(commit) = decode_commit(commit, &self.file.about.camera, octaves) else { break };
                if commit.version > self.file.snapshot.version() {
                    let Some(snapshot) = applied(&self.file.snapshot, &commit) else {
                        return self.begin_again();
                    };
                    self.file.snapshot = snapshot;
                    then(commit);
                }
                read = next;
            }
            self.at += read as u64;
            if !self.next_log()? {
                return Ok(true);
            }
        }
    }

    /// The bytes after the last whole commit; `None` when the log is gone, since a newer base has replaced it.
    fn written(&self) -> Result<Option<Vec<u8>>, JournalError> {
        let failed = failed(&self.log, "read");
        let mut log = match File::open(&self.log) {
            Ok(log) => log,
            Err(e) if e.kind() == ErrorKind::NotFound => return Ok(None),
            Err(e) => return Err(failed(e)),
        };
        let mut bytes = Vec::new();
        log.seek(SeekFrom::Start(self.at)).and_then(|_| log.read_to_end(&mut bytes)).map_err(&failed)?;
        Ok(Some(bytes))
    }

    /// Goes on to the log after this one, if there is one that has begun.
    fn next_log(&mut self) -> Result<bool, JournalError> {
        let logs = versions(&self.folder)?.into_iter().map(|(_, path)| path);
        let Some(next) = logs.filter(|path| !super::is_base(path)).find(|path| *path > self.log) else {
            return Ok(false);
        };
        let mut header = Vec::new();
        let begun = File::open(&next).and_then(|log| log.take(HEADER as u64).read_to_end(&mut header));
        if begun.is_err() || check(&next, &header)?.is_none() {
            return Ok(false);
        }
        (self.log, self.at) = (next, HEADER as u64);
        Ok(true)
    }

    fn begin_again(&mut self) -> Result<bool, JournalError> {
        if let Some(anew) = Self::open(&self.folder)?.filter(|t| t.map().version() >= self.map().version()) {
            let has_all = anew.map().version() == self.map().version();
            *self = anew;
            return Ok(has_all);
        }
        Ok(true)
    }
}
