//! Mapping one recording: in lockstep, so that the same recording gives the same file.

use super::bytes_of;
use crate::FleetError;
use crate::places;
use crate::shelf::Shelf;
use crate::task::{Mapped, Result as Found};
use cairn::atlas::store::MapFile;
use cairn::{Config, Slam, map_file};
use std::collections::BTreeMap;
use std::path::Path;

/// Maps the recording at a path; a saved map is taken as it is.
pub(crate) fn map(shelf: &Shelf, path: &Path, config: &Config) -> Result<Found, FleetError> {
    if path.extension().is_some_and(|e| e == "map") {
        return match MapFile::load(path) {
            Ok(file) => keep(shelf, &file, 0, 0.0),
            Err(e) => Ok(Found::Unmapped { why: e.to_string() }),
        };
    }
    let address = path.display().to_string();
    let unmapped = |why: String| Ok(Found::Unmapped { why });
    let mut source = match cairn::open(&address) {
        Ok(source) => source,
        Err(e) => return unmapped(e.to_string()),
    };
    let mut slam = match Slam::for_source(&*source).config(config).build() {
        Ok(slam) => slam,
        Err(e) => return unmapped(e.to_string()),
    };
    let (mut frames, mut first, mut last) = (0, None, 0);
    loop {
        match source.next_packet() {
            Ok(Some(packet)) => {
                frames += 1;
                first.get_or_insert(packet.stamp.0);
                last = packet.stamp.0;
                // A frame that is refused is left out, as in `cairn run`.
                let _ = slam.track(&packet);
            }
            Ok(None) => break,
            Err(e) => return unmapped(e.to_string()),
        }
    }
    slam.finish();
    let Some(file) = map_file(slam.session(), &BTreeMap::new()) else {
        return unmapped(format!("no map came of its {frames} frames"));
    };
    keep(shelf, &file, frames, first.map_or(0.0, |first: i64| (last - first) as f64 / 1e9))
}

fn keep(shelf: &Shelf, file: &MapFile, frames: usize, recorded_s: f64) -> Result<Found, FleetError> {
    Ok(Found::Mapped(Mapped {
        map: shelf.keep(&bytes_of(file)?)?,
        places: shelf.keep(&places::write(&places::of_map(file))?)?,
        key_frames: file.snapshot.key_frame_count(),
        maps: file.snapshot.maps().count(),
        frames,
        recorded_s,
    }))
}
