//! The sentences about kept routes, all in one place.

use super::RouteEntry;
use super::WallTime;
use cairn_guide::PhraseConfig;

/// How many routes are named when the list is spoken.
const SPOKEN: usize = 5;

pub(crate) const GUIDING: &str = "Guidance is running. Halt it first.";
pub(crate) const NO_ROUTES: &str = "There is no recorded route.";
pub(crate) const NO_QUESTION: &str = "There is no question to answer.";
pub(crate) const KEPT: &str = "Nothing was deleted.";
pub(crate) const BEING_RECORDED: &str = "That route is being recorded. Stop the recording first.";
pub(crate) const NOT_RECORDING: &str = "Notes belong to a route. Start recording first.";
pub(crate) const NO_PLACE: &str = "I do not know where I am. Try the note again in a moment.";
pub(crate) const MARKED: &str = "The place is marked. Now say or write what is here.";
pub(crate) const OTHER_MAP: &str = "That route belongs to a map that is not loaded.";
pub(crate) const SEARCHING: &str =
    "I do not recognise this place yet. Turn slowly on the spot, or go nearer to the route.";
pub(crate) const MAP_SAVED_AGAIN: &str = "The map is saved again.";
pub(crate) const FULL: &str =
    "Recording in memory only, because there is no room for more routes. Delete some first.";
/// What a note says that has no text.
pub(crate) const LANDMARK: &str = "landmark";

/// "Route 3, to the kitchen, 40 metres, yesterday".
pub(crate) fn route(entry: &RouteEntry, now: WallTime, phrases: &PhraseConfig) -> String {
    let mut words = short(entry);
    if let Some(metres) = entry.length_m {
        words += &format!(", {}", phrases.distance(metres));
    }
    if let Some(recorded_s) = entry.recorded_s {
        words += &format!(", {}", when(now.days_since(recorded_s)));
    }
    words
}

/// "Route 3, to the kitchen".
pub(crate) fn short(entry: &RouteEntry) -> String {
    let name = entry.name.as_ref().map_or_else(String::new, |name| format!(", {name}"));
    format!("Route {}{name}", entry.number)
}

pub(crate) fn when(days: i64) -> String {
    match days {
        0 => "today".into(),
        1 => "yesterday".into(),
        2..14 => format!("{days} days ago"),
        14..60 => format!("{} weeks ago", days / 7),
        60..730 => format!("{} months ago", days / 30),
        _ => format!("{} years ago", days / 365),
    }
}

/// The newest routes, newest first.
pub(crate) fn list<'a>(
    newest_first: impl ExactSizeIterator<Item = &'a RouteEntry>,
    now: WallTime,
    phrases: &PhraseConfig,
) -> String {
    let count = newest_first.len();
    let mut words = match count {
        0 => return NO_ROUTES.into(),
        1 => "One route.".to_owned(),
        n => format!("{n} routes."),
    };
    for entry in newest_first.take(SPOKEN) {
        words += &format!(" {}.", route(entry, now, phrases));
    }
    match count.saturating_sub(SPOKEN) {
        0 => words,
        1 => words + " And one older route.",
        more => format!("{words} And {more} older routes."),
    }
}

pub(crate) fn loaded(route: &str, notes: usize, why_not: Option<&str>) -> String {
    let notes = match notes {
        0 => String::new(),
        1 => ", with one note".into(),
        n => format!(", with {n} notes"),
    };
    match why_not {
        None => format!("{route}{notes}. Loaded."),
        Some(why) => format!("{route}{notes}. Loaded, but I cannot guide along it: {why}."),
    }
}

pub(crate) fn map_not_saved(why: &str) -> String {
    format!("The map cannot be saved: {why}. Today's routes can be walked until I am switched off.")
}

pub(crate) fn unknown(number: u32) -> String {
    format!("There is no route {number}.")
}

pub(crate) fn renamed(entry: &RouteEntry) -> String {
    format!("{}. Named.", short(entry))
}

pub(crate) fn ask_delete(route: &str) -> String {
    format!("Delete {}{}? Answer yes or no.", route[..1].to_lowercase(), &route[1..])
}

pub(crate) fn deleted(entry: &RouteEntry) -> String {
    format!("{} is deleted.", short(entry))
}

pub(crate) fn failed(doing: &str, why: impl std::fmt::Display) -> String {
    format!("The route cannot be {doing}: {why}.")
}

pub(crate) fn noted(text: &str, side: Option<cairn_guide::Side>) -> String {
    match side {
        Some(side) => format!("Noted: {text} on the {}.", side.word()),
        None => format!("Noted: {text}."),
    }
}

/// Why a route cannot be walked, after a colon.
pub(crate) fn why_not(why: WhyNot) -> &'static str {
    match why {
        WhyNot::OtherMap => "it was recorded with another camera or on another map",
        WhyNot::Unreadable => "its file is damaged",
    }
}

/// Why a route cannot be walked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum WhyNot {
    OtherMap,
    Unreadable,
}
