//! A route as it is listed for people.

use super::{RouteEntry, WallTime, words};
use cairn_guide::PhraseConfig;
use serde::Serialize;

/// A route as it is listed for people.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RouteListed {
    /// Its number.
    pub number: u32,
    /// Its name, if it was given one.
    pub name: Option<String>,
    /// "Route 3, to the kitchen, 40 metres, yesterday".
    pub words: String,
    /// When it was recorded: seconds since 1970-01-01 00:00 UTC.
    pub recorded_s: Option<i64>,
    /// Number of notes.
    pub notes: usize,
    /// Why it cannot be walked with the map at hand.
    pub why_not: Option<String>,
    /// It is the route at hand.
    pub loaded: bool,
}

impl RouteListed {
    pub(crate) fn of(
        entry: &RouteEntry,
        now: WallTime,
        phrases: &PhraseConfig,
        why_not: Option<words::RouteProblem>,
        loaded: bool,
    ) -> Self {
        Self {
            number: entry.number,
            name: entry.name.clone(),
            words: words::route(entry, now, phrases),
            recorded_s: entry.recorded_s,
            notes: entry.notes,
            why_not: why_not.map(|why| words::why_not(why, phrases.language)),
            loaded,
        }
    }
}
