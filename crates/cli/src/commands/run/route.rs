//! Continuing a recorded route in the map it was recorded in.

use crate::failure::Failure;
use cairn_atlas::store::MapFile;
use cairn_eval::write_whole;
use cairn_guide::{Recorder, RecorderConfig, Route, RouteError, RouteWriter};
use cairn_session::unit_of;
use std::path::Path;

/// Checks before anything is opened that the route of --guide can be read.
///
/// # Errors
/// When it cannot be read or is no route.
pub fn check(path: &Path) -> Result<(), Failure> {
    let fail = |e: RouteError| {
        let why = match e {
            RouteError::File { source, .. } => format!("cannot be read ({source})"),
            e => e.to_string(),
        };
        Failure::new(path.display().to_string(), why, "give a file that cairn run --record wrote")
    };
    Route::load(path).map(drop).map_err(fail)
}

/// Continues a route whose key frames are in this map.
///
/// # Errors
/// When the file cannot be read or written, or the route belongs to another map; it is then left unchanged.
pub fn resume(path: &Path, map: &MapFile, config: RecorderConfig) -> Result<Recorder, Failure> {
    let shown = path.display().to_string();
    let failed =
        |e: RouteError| Failure::new(&shown, e.to_string(), "give another name to record a new route");
    let mut route = Route::load(path).map_err(failed)?;
    // After a crash the route is newer than the map: its last points are anchored to key frames that were not saved.
    match route.reanchor(|anchor| unit_of(&map.snapshot, anchor)) {
        Some(0) => {}
        Some(_) => {
            let bytes = route.to_bytes().map_err(|e| {
                Failure::new(&shown, e.to_string(), "check that its folder is writable and the disk has room")
            })?;
            write_whole(path, &String::from_utf8_lossy(&bytes))?;
        }
        None if route.points.is_empty() => {}
        None => {
            let why = "none of the key frames it is anchored to is in the map of --map-in";
            let hint = "give the map it was recorded in, or another name to record a new route";
            return Err(Failure::new(shown, why, hint));
        }
    }
    let (route, writer) = RouteWriter::resume(path).map_err(failed)?;
    Ok(Recorder::resume(config, route).with_writer(writer))
}
