//! A way that is gone on with in the map it hangs on.

use crate::failure::Failure;
use cairn_atlas::store::MapFile;
use cairn_eval::write_whole;
use cairn_guide::{Anchor, Recorder, RecorderConfig, Route, RouteError, RouteWriter};
use std::path::Path;

/// Goes on with a record that hangs on this map; one that does not is refused and left as it is.
pub fn resume(path: &Path, snapshot: &MapFile) -> Result<Recorder, Failure> {
    let shown = path.display().to_string();
    let told = |e: RouteError| Failure::new(&shown, e.to_string(), "give another name for a new record");
    let mut route = Route::load(path).map_err(told)?;
    let known = |anchor: Anchor| {
        cairn_atlas::KeyFrameId::from_index(anchor.seq as usize)
            .is_some_and(|id| snapshot.snapshot.surviving_ancestor(id).is_some())
    };
    // After a crash the record is younger than the map: its last points hang on key frames that were not saved.
    match route.reanchor(known) {
        Some(0) => {}
        Some(_) => {
            let bytes = route.to_bytes().map_err(|e| {
                Failure::new(&shown, e.to_string(), "check that its folder may be written and has room")
            })?;
            write_whole(path, &String::from_utf8_lossy(&bytes))?;
        }
        None if route.points.is_empty() => {}
        None => {
            let why = "none of the key frames it hangs on is in the map of --map-in";
            let hint = "give the map it was recorded in, or another name for a new record";
            return Err(Failure::new(shown, why, hint));
        }
    }
    let (route, writer) = RouteWriter::resume(path).map_err(told)?;
    Ok(Recorder::resume(RecorderConfig::default(), route).with_writer(writer))
}
