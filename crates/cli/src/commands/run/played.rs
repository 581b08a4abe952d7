//! Playing a source for a session: as fast as it is processed, paced, only what a journal has, or live.

use super::arguments::Arguments;
use crate::failure::Failure;
use crate::interrupt;
use crate::output::warn;
use cairn_sensor::{Skips, Source, SourceError, Stamp};
use cairn_session::{Clock, Ended, Inbox, Item, Observer, Script, Session, drive, feed};
use cairn_sources::{Paced, Picked};
use std::time::{Duration, Instant};

/// How a source was played.
pub struct Played {
    pub driven: Result<Ended, SourceError>,
    /// Frames that were left out because they came too fast.
    pub dropped: usize,
    /// What the source left out, and the first of it in words.
    pub skips: Skips,
    skipped: Vec<String>,
}

/// Plays a source that is not live: in real time where that is asked for, else those of its packets that have these stamps,
/// or all.
pub fn recorded(
    a: &Arguments,
    source: Box<dyn Source>,
    stamps: Option<Vec<Stamp>>,
    session: &mut Session,
    script: &mut Script,
    observer: &mut dyn Observer,
) -> Played {
    let mut source: Box<dyn Source> = match stamps {
        _ if a.realtime => Box::new(Paced::new(source).cancelled_by(interrupt::cancel())),
        Some(stamps) => Box::new(Picked::new(source, stamps)),
        None => source,
    };
    let clock = if a.realtime { Clock::Paced(&mut *source) } else { Clock::Packets(&mut *source) };
    let driven = drive(session, clock, script, observer);
    let skipped = source.skipped().to_vec();
    Played { driven, dropped: source.dropped(), skips: source.skips(), skipped }
}

/// Plays a live source.
///
/// # Errors
/// When there is no thread to read it.
pub fn live(
    a: &Arguments,
    source: Box<dyn Source>,
    session: &mut Session,
    script: &mut Script,
    observer: &mut dyn Observer,
) -> Result<Played, Failure> {
    let inbox = Inbox::new();
    feed(source, inbox.clone())
        .map_err(|e| Failure::new(&a.source, e.to_string(), "close other programs and try again"))?;
    let driven = drive(session, Clock::Wall(&inbox), script, observer);
    inbox.close();
    let dropped = inbox.dropped();
    // A stream's child process ends with it; without one that listens, its port would stay taken.
    let ended = Instant::now();
    while interrupt::requested() && ended.elapsed() < Duration::from_millis(300) {
        if matches!(inbox.take(Duration::from_millis(20)), Item::Ended(_)) {
            break;
        }
    }
    Ok(Played { driven, dropped, skips: Skips::default(), skipped: Vec::new() })
}

impl Played {
    /// Warns of what the source has skipped.
    pub fn warn(&self) {
        const SHOWN: usize = 5;
        for line in self.skipped.iter().take(SHOWN) {
            warn(&format!("skipped: {line}"));
        }
        if self.skipped.len() > SHOWN {
            warn(&format!("skipped: and {} more", self.skipped.len() - SHOWN));
        }
    }
}
