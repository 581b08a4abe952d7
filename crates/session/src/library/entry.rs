//! What is known of a kept route without holding it in memory.

use cairn_guide::Route;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// A route of a folder.
#[derive(Clone, Debug, PartialEq)]
pub struct RouteEntry {
    /// Its number, part of the file's name.
    pub number: u32,
    /// Its file.
    pub path: PathBuf,
    /// Its name, if it was given one.
    pub name: Option<String>,
    /// When it was recorded: seconds since 1970-01-01 00:00 UTC.
    pub recorded_s: Option<i64>,
    /// The atlas that it is anchored in, where that is kept.
    pub atlas: Option<String>,
    /// Metres as recorded; `None` where the scale is not known.
    pub length_m: Option<f64>,
    /// It was recorded with a lens that was a guess: its length may be wrong by a third, and nobody is guided along it.
    pub lens_guessed: bool,
    /// Number of points.
    pub points: usize,
    /// Number of notes.
    pub notes: usize,
    /// Why its file cannot be read.
    pub damage: Option<String>,
}

impl RouteEntry {
    /// Of a route in memory; without a date of its own it has that of its file.
    pub(crate) fn of(number: u32, path: &Path, route: &Route) -> Self {
        let header = &route.header;
        let at = |k: usize| route.points[k].odom_from_camera.translation;
        let length: f64 = (1..route.points.len()).map(|k| (at(k) - at(k - 1)).norm()).sum();
        Self {
            number,
            path: path.to_owned(),
            name: header.name.clone(),
            recorded_s: header.recorded_s.or_else(|| written_s(path)),
            atlas: header.atlas.clone(),
            length_m: header.metric.then_some(length),
            lens_guessed: header.lens_guessed,
            points: route.points.len(),
            notes: route.notes.len(),
            damage: None,
        }
    }

    /// Of a file, read whole and forgotten.
    pub(crate) fn read(number: u32, path: &Path) -> Self {
        match Route::load(path) {
            Ok(route) => Self::of(number, path, &route),
            Err(e) => Self {
                number,
                path: path.to_owned(),
                name: None,
                recorded_s: written_s(path),
                atlas: None,
                length_m: None,
                lens_guessed: false,
                points: 0,
                notes: 0,
                damage: Some(e.to_string()),
            },
        }
    }
}

/// When a file was written.
fn written_s(path: &Path) -> Option<i64> {
    let written: SystemTime = std::fs::metadata(path).and_then(|m| m.modified()).ok()?;
    i64::try_from(written.duration_since(UNIX_EPOCH).ok()?.as_secs()).ok()
}
