//! `--journal` and `--replay`.

use super::Arguments;
use crate::failure::Failure;
use cairn_engine::{Engine, Journal, Stopped};
use std::fs::File;
use std::io::BufWriter;

/// The journal of --replay.
pub fn opened(a: &Arguments) -> Result<Option<Journal>, Failure> {
    let Some(path) = &a.replay else { return Ok(None) };
    let fail = |why: String| {
        let hint = "give a file that cairn run --realtime --journal has written";
        Failure::new(path.display().to_string(), why, hint)
    };
    let bytes = std::fs::read(path).map_err(|e| fail(e.to_string()))?;
    Journal::read(&bytes).map(Some).map_err(|e| fail(e.to_string()))
}

/// The engine, as it is to go on: writing a journal, or as one tells.
pub fn engine(
    a: &Arguments,
    engine: Engine,
    source: &str,
    journal: Option<Journal>,
) -> Result<Engine, Failure> {
    if let Some(path) = &a.journal {
        let shown = path.display().to_string();
        let file = File::create(path)
            .map_err(|e| Failure::new(shown, e.to_string(), "check that its folder may be written"))?;
        engine.write_journal(source, Box::new(BufWriter::new(file)));
    }
    let (Some(journal), Some(path)) = (journal, &a.replay) else { return Ok(engine) };
    engine.replay(source, journal).map_err(|why| {
        let hint = "replay with the source and the options of the run that wrote it";
        Failure::new(path.display().to_string(), why, hint)
    })
}

/// Whether the journal is whole, or what was replayed came out the same.
pub fn end(a: &Arguments, engine: &Engine) -> Result<(), Failure> {
    if let (Some(path), Some(why)) = (&a.journal, engine.journal_failed()) {
        return Err(Failure::new(path.display().to_string(), why, "make room on the disk"));
    }
    let (Some(path), Some(told)) = (&a.replay, engine.replayed()) else { return Ok(()) };
    let shown = path.display().to_string();
    match &told.stopped {
        None => eprintln!(
            "replay: {} of {} frames equal bit for bit{}",
            told.equal,
            told.of,
            if told.map_equal { ", and the map" } else { "" }
        ),
        Some(Stopped::Cut(why)) => eprintln!(
            "warning: {shown}: cut off at {why}; {} of its {} frames were replayed, all equal",
            told.equal, told.of
        ),
        Some(Stopped::Differs { stamp, what }) => {
            let at = stamp.map_or("after the last frame".into(), |s| format!("frame at {s}"));
            let why = format!("{at}: {what}; the {} frames before are equal", told.equal);
            let hint =
                "the same program, source and options on the same kind of processor give the same bits";
            return Err(Failure::new(shown, why, hint));
        }
    }
    Ok(())
}
