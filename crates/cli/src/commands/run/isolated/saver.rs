//! Saves the map to --map-out while the run goes on, as the journal has it: a supervisor that dies leaves a map of a moment ago.

use crate::commands::map::failed;
use crate::commands::run::Arguments;
use cairn_atlas::store::StoreError;
use cairn_workers::journal::recover;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The journal may get a new base while it is read; then it is read again.
const TRIES: usize = 3;

/// Saves it, on a thread of its own: the supervisor waits for no disk.
pub(super) struct Saver {
    journal: PathBuf,
    to: Option<PathBuf>,
    every: Duration,
    /// The attachments of the map of --map-in, its depth too.
    attached: BTreeMap<String, Vec<u8>>,
    last: Instant,
    work: Option<JoinHandle<Result<(), StoreError>>>,
}

impl Saver {
    /// From the journal in a folder to the checked file of --map-out, as the arguments say.
    pub(super) fn new(
        a: &Arguments,
        journal: &Path,
        to: Option<&Path>,
        attached: BTreeMap<String, Vec<u8>>,
    ) -> Self {
        Self {
            journal: journal.to_owned(),
            to: to.map(Path::to_owned),
            every: Duration::try_from_secs_f64(a.map_every).unwrap_or(Duration::MAX),
            attached,
            last: Instant::now(),
            work: None,
        }
    }

    /// Starts a save if one is due and the previous one is done; returns why that one failed. It is tried again.
    pub(super) fn save_if_due(&mut self) -> Option<String> {
        let to = self.to.as_deref()?;
        if self.last.elapsed() < self.every || self.work.as_ref().is_some_and(|work| !work.is_finished()) {
            return None;
        }
        self.last = Instant::now();
        let before = self.work.take().map(JoinHandle::join);
        let (journal, to, attached) = (self.journal.clone(), to.to_owned(), self.attached.clone());
        let path = to.clone();
        let save = move || saved(&journal, &to, attached);
        self.work = std::thread::Builder::new().name("cairn-save".into()).spawn(save).ok();
        match before {
            Some(Ok(Err(e))) => Some(failed(&path, &e).to_string()),
            _ => None,
        }
    }
}

impl Drop for Saver {
    /// The map at the end is saved after this one.
    fn drop(&mut self) {
        drop(self.work.take().map(JoinHandle::join));
    }
}

/// Saves the map of a journal where it has key frames.
fn saved(journal: &Path, to: &Path, attached: BTreeMap<String, Vec<u8>>) -> Result<(), StoreError> {
    // A journal that cannot be read is told by those who write it.
    let found = (0..TRIES).find_map(|_| recover(journal).ok()).flatten();
    let Some(mut file) = found.map(|r| r.file).filter(|file| file.snapshot.key_frame_count() > 0) else {
        return Ok(());
    };
    file.attached.extend(attached);
    file.save(to).map(drop)
}
