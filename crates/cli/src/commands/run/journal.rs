//! `--journal` and `--replay`: writing and replaying the journal of a real-time run.

use super::arguments::Arguments;
use super::sink::Ended;
use crate::failure::Failure;
use crate::output::{note, warn};
use crate::outputs::Outputs;
use cairn_engine::{Engine, Journal, JournalError, Replayed, Stopped};
use cairn_files::MIB;
use cairn_sources::is_live;
use std::fs::File;
use std::io::BufWriter;

/// Reads the journal given by --replay.
///
/// # Errors
/// When the file cannot be read or is not a journal, or the source is live.
pub fn opened(a: &Arguments) -> Result<Option<Journal>, Failure> {
    if is_live(&a.source) && (a.journal.is_some() || a.replay.is_some()) {
        let hint = "record it first and run the recording";
        return Err(Failure::new(&a.source, "a live source cannot be replayed", hint));
    }
    let Some(path) = &a.replay else { return Ok(None) };
    let fail = |why: String, hint| Failure::new(path.display().to_string(), why, hint);
    let written = "give a file that cairn run --realtime --journal has written";
    let bytes = cairn_files::read(path, 1024 * MIB).map_err(|e| fail(e.to_string(), written))?;
    Journal::read(&bytes).map(Some).map_err(|e| {
        let hint = match &e {
            JournalError::Foreign if bytes.is_empty() => {
                "it is empty: the run that wrote it ended before its first frame"
            }
            JournalError::Foreign => written,
            JournalError::Version { .. } => {
                "replay it with the version of Cairn that wrote it, or record it anew"
            }
            JournalError::Head { .. } => {
                "it breaks off before its first frame, so nothing of it can be replayed; record it anew"
            }
        };
        fail(e.to_string(), hint)
    })
}

/// Lets the engine write a journal or replay one, as the arguments say.
///
/// # Errors
/// When the journal cannot be created, or belongs to another source or other options.
pub fn engine(
    a: &Arguments,
    outputs: &Outputs,
    engine: Engine,
    source: &str,
    journal: Option<Journal>,
) -> Result<Engine, Failure> {
    if let Some(path) = outputs.file("--journal") {
        let shown = path.display().to_string();
        let file = File::create(path)
            .map_err(|e| Failure::new(shown, e.to_string(), "check that its folder is writable"))?;
        engine.write_journal(source, Box::new(BufWriter::new(file)));
    }
    let (Some(journal), Some(path)) = (journal, &a.replay) else { return Ok(engine) };
    engine.replay(source, journal).map_err(|why| {
        let hint = "replay with the same source and options as the run that wrote it";
        Failure::new(path.display().to_string(), why.to_string(), hint)
    })
}

/// Checks that the journal was written completely, or that the replay matched.
///
/// # Errors
/// When writing the journal failed, or the replay differs from it.
pub fn end(a: &Arguments, ended: &mut Ended) -> Result<(), Failure> {
    let Some(here) = ended.run.here() else { return Ok(()) };
    let engine = here.session.engine();
    if let (Some(path), Some(why)) = (&a.journal, engine.journal_failed()) {
        return Err(Failure::new(path.display().to_string(), why, "free some space on the disk"));
    }
    match (&a.replay, engine.replayed()) {
        (Some(path), Some(replay)) => report(&path.display().to_string(), replay),
        _ => Ok(()),
    }
}

/// Reports what a replay showed.
fn report(journal: &str, replay: &Replayed) -> Result<(), Failure> {
    match &replay.stopped {
        None => note(&format!(
            "replay: {} of {} frames equal bit for bit{}",
            replay.equal,
            replay.of,
            if replay.map_equal { ", and the map" } else { "" }
        )),
        Some(Stopped::Cut(why)) => warn(&format!(
            "{journal}: incomplete ({why}); {} of its {} frames were replayed, all equal",
            replay.equal, replay.of
        )),
        Some(Stopped::Differs { stamp, what }) => {
            let at = stamp.map_or("after the last frame".into(), |s| format!("frame at {s}"));
            let why = format!("{at}: {what}; the {} frames before are equal", replay.equal);
            let hint =
                "the same program, source and options on the same kind of processor give the same bits";
            return Err(Failure::new(journal, why, hint));
        }
    }
    Ok(())
}
