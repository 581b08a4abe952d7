//! Saves the map to --map-out while the run goes on, as the journal has it: a supervisor that dies leaves a map of a moment ago.

use crate::commands::map::failed;
use crate::commands::run::Arguments;
use crate::commands::run::sink::{Ended, Sink, Step};
use crate::failure::Failure;
use crate::progress::Progress;
use cairn_atlas::store::StoreError;
use cairn_workers::journal::recover;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The journal may get a new base while it is read; then it is read again.
const TRIES: usize = 3;

/// Saves it, on a thread of its own: the supervisor waits for no disk.
pub(super) struct Saver<'a> {
    journal: PathBuf,
    to: &'a Path,
    every: Duration,
    /// The attachments of the map of --map-in, its depth too.
    attached: BTreeMap<String, Vec<u8>>,
    last: Instant,
    work: Option<JoinHandle<Result<(), StoreError>>>,
    progress: Rc<Progress>,
}

impl<'a> Saver<'a> {
    /// From the journal in a folder to the checked file of --map-out, as the arguments say, if there is one.
    pub(super) fn begin(
        a: &Arguments,
        journal: &Path,
        to: Option<&'a Path>,
        attached: BTreeMap<String, Vec<u8>>,
        progress: Rc<Progress>,
    ) -> Option<Self> {
        let every = Duration::try_from_secs_f64(a.map_every).unwrap_or(Duration::MAX);
        let (journal, last) = (journal.to_owned(), Instant::now());
        Some(Self { journal, to: to?, every, attached, last, work: None, progress })
    }
}

impl Sink for Saver<'_> {
    /// Starts a save if one is due and the previous one is done. Failures are reported and retried.
    fn step(&mut self, _: &mut Step) {
        if self.last.elapsed() < self.every || self.work.as_ref().is_some_and(|work| !work.is_finished()) {
            return;
        }
        self.last = Instant::now();
        if let Some(Ok(Err(e))) = self.work.take().map(JoinHandle::join) {
            self.progress.warn(&failed(self.to, &e).to_string());
        }
        let (journal, to, attached) = (self.journal.clone(), self.to.to_owned(), self.attached.clone());
        let save = move || saved(&journal, &to, attached);
        self.work = std::thread::Builder::new().name("cairn-save".into()).spawn(save).ok();
    }

    /// The map at the end is saved after this one.
    fn end(mut self: Box<Self>, _: &mut Ended) -> Result<(), Failure> {
        drop(self.work.take().map(JoinHandle::join));
        Ok(())
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
