//! A folder of recorded routes, known by their numbers.
//!
//! The folder itself is the list. It is looked at again at every command, and only files that have changed are read.

use super::{LONGEST_NAME, RouteEntry};
use crate::disk::Disk;
use cairn_guide::{Route, RouteError};
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Size and time of a file: while both stay, its content does.
type Signature = (u64, Option<SystemTime>);

/// The folder.
pub(crate) struct RouteFolder {
    path: PathBuf,
    entries: BTreeMap<u32, (Signature, RouteEntry)>,
    /// Counts what changed.
    version: u64,
}

impl RouteFolder {
    /// A folder, which need not exist.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), entries: BTreeMap::new(), version: 0 }
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Counts the changes seen.
    pub fn version(&self) -> u64 {
        self.version
    }

    /// Looks at the folder; `except` is being written and left out.
    pub fn refresh(&mut self, except: Option<&Path>) {
        let mut found = BTreeMap::new();
        for (number, path) in numbered(&self.path) {
            if except != Some(&path) {
                found.entry(number).or_insert(path);
            }
        }
        let before = self.entries.len();
        self.entries.retain(|number, (_, entry)| found.get(number) == Some(&entry.path));
        let mut changed = self.entries.len() != before;
        for (number, path) in found {
            let Ok(metadata) = std::fs::metadata(&path) else { continue };
            let signature = (metadata.len(), metadata.modified().ok());
            if self.entries.get(&number).is_none_or(|(known, _)| *known != signature) {
                self.entries.insert(number, (signature, RouteEntry::read(number, &path)));
                changed = true;
            }
        }
        self.version += u64::from(changed);
    }

    /// The routes seen at the last look, oldest first.
    pub fn entries(&self) -> impl DoubleEndedIterator<Item = &RouteEntry> + ExactSizeIterator {
        self.entries.values().map(|(_, entry)| entry)
    }

    /// The routes, newest first.
    pub fn newest_first(&self) -> Vec<&RouteEntry> {
        let mut all: Vec<&RouteEntry> = self.entries().collect();
        all.sort_by_key(|e| std::cmp::Reverse((e.recorded_s, e.number)));
        all
    }

    /// A route by its number.
    pub fn get(&self, number: u32) -> Option<&RouteEntry> {
        self.entries.get(&number).map(|(_, entry)| entry)
    }

    /// The route in this file.
    pub fn by_path(&self, path: &Path) -> Option<&RouteEntry> {
        self.entries().find(|e| e.path == path)
    }

    /// `route-0007.route`: one more than the highest number there.
    pub fn next_path(&self) -> PathBuf {
        let highest = numbered(&self.path).into_iter().map(|(n, _)| n).max().unwrap_or(0);
        self.path.join(format!("route-{:04}.route", highest.saturating_add(1)))
    }

    /// Gives a route a name that [`checked_name`] accepted, in its file, completely or not at all.
    ///
    /// # Errors
    /// When the file cannot be read or written.
    pub fn rename(&mut self, number: u32, name: String, disk: &dyn Disk) -> Result<(), RenameError> {
        let Some(path) = self.get(number).map(|e| e.path.clone()) else { return Ok(()) };
        let mut route = Route::load(&path)?;
        route.header.name = Some(name);
        Ok(replace(disk, &path, &route)?)
    }

    /// Deletes the file of a route.
    ///
    /// # Errors
    /// The system's error.
    pub fn remove(&mut self, number: u32) -> io::Result<()> {
        let Some(path) = self.get(number).map(|e| e.path.clone()) else { return Ok(()) };
        std::fs::remove_file(path)
    }
}

/// Writes a route in the place of its file, completely or not at all.
pub(crate) fn replace(disk: &dyn Disk, path: &Path, route: &Route) -> io::Result<()> {
    disk.replace(path, &route.to_bytes()?)
}

/// Why a route keeps its name.
#[derive(Debug, thiserror::Error)]
pub(crate) enum RenameError {
    /// Its file cannot be read.
    #[error(transparent)]
    Read(#[from] RouteError),
    /// Its file cannot be written.
    #[error(transparent)]
    Write(#[from] io::Error),
}

/// What is wrong with a name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NameError {
    /// It has no letter.
    Empty,
    /// It is longer than is said at once.
    Long,
    /// It has characters that nobody can say.
    Unsayable,
}

impl NameError {
    /// The id of the sentence that says so.
    pub fn sentence(self) -> &'static str {
        match self {
            Self::Empty => "walk-name-empty",
            Self::Long => "walk-name-long",
            Self::Unsayable => "walk-name-unsayable",
        }
    }
}

/// A name in the form that is kept.
///
/// # Errors
/// What is wrong with it.
pub(crate) fn checked_name(name: &str) -> Result<String, NameError> {
    let name = name.split_whitespace().collect::<Vec<_>>().join(" ");
    match name.chars().count() {
        0 => Err(NameError::Empty),
        n if n > LONGEST_NAME => Err(NameError::Long),
        _ if name.chars().any(char::is_control) => Err(NameError::Unsayable),
        _ => Ok(name),
    }
}

/// The files of routes with a number, in order; of two with the same number the one with the shorter suffix comes last.
pub(crate) fn numbered(folder: &Path) -> Vec<(u32, PathBuf)> {
    let mut all: Vec<(u32, PathBuf)> =
        routes_in(folder).into_iter().filter_map(|(n, path)| Some((n?, path))).collect();
    all.sort();
    all
}

/// The number in the name of a route's file.
pub(crate) fn number_of(path: &Path) -> Option<u32> {
    let stem = path.file_stem()?.to_str()?;
    stem.strip_prefix("route-").or_else(|| stem.strip_prefix("way-"))?.parse().ok()
}

/// The files of routes in a folder, with the number in their names.
pub(crate) fn routes_in(folder: &Path) -> Vec<(Option<u32>, PathBuf)> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    (entries.flatten().map(|e| e.path()))
        .filter(|p| p.extension().is_some_and(|e| e == "route" || e == "way") && p.is_file())
        .map(|p| (number_of(&p), p))
        .collect()
}

/// The route written last: by its time, then by its number.
pub(crate) fn latest(folder: &Path) -> Option<PathBuf> {
    let written = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    let mut routes = routes_in(folder);
    routes.sort_by(|(a, p), (b, q)| written(p).cmp(&written(q)).then(a.cmp(b)).then(p.cmp(q)));
    routes.pop().map(|(_, path)| path)
}
