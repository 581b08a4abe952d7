//! Routes kept for another day: a folder of recorded routes with names, and the one atlas that they are anchored in.
//!
//! The folder has one file for each route and one for each atlas (`atlas-ID.map`); a route names its atlas. There is no
//! index that could contradict them: a name is part of its route's file.

mod entry;
mod error;
mod folder;
mod keeper;
mod listed;
mod wall;
pub(crate) mod words;

use cairn_guide::PhraseConfig;
pub use entry::RouteEntry;
pub use error::{KeepError, LibraryError};
pub(crate) use folder::{RouteFolder, checked_name, latest, number_of, replace};
pub use keeper::{Kept, LibraryCamera, MapKeeper, RoutesLock};
pub use listed::RouteListed;
pub use wall::{WallClock, WallTime};
pub(crate) use words::SPOKEN;

/// The routes of a folder, newest first, before a session is there that could say which of them can be walked.
pub fn routes_in(folder: &std::path::Path, now: WallTime, phrases: &PhraseConfig) -> Vec<RouteListed> {
    let mut routes = RouteFolder::new(folder);
    routes.refresh(None);
    let damaged = |e: &RouteEntry| e.damage.as_ref().map(|_| words::RouteProblem::Unreadable);
    routes.newest_first().into_iter().map(|e| RouteListed::of(e, now, phrases, damaged(e), false)).collect()
}

/// How many routes a library takes; further ones are recorded into memory only.
pub const MOST_ROUTES: usize = 500;
/// With how many key frames a map is saved at most: about a gigabyte of memory.
pub const MOST_KEY_FRAMES: usize = 5000;
/// How many characters a name may have.
pub const LONGEST_NAME: usize = 60;
