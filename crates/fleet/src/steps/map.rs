//! Mapping one recording: in lockstep, so that the same recording gives the same file.

use super::bytes_of;
use crate::FleetError;
use crate::shelf::Shelf;
use crate::task::{Mapped, Result as Found};
use crate::words;
use cairn::{Config, Slam, map_file};
use std::collections::BTreeMap;
use std::path::Path;

/// Maps the recording at a path.
pub(crate) fn map(shelf: &Shelf, path: &Path, config: &Config) -> Result<Found, FleetError> {
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
    Ok(Found::Mapped(Mapped {
        map: shelf.keep(&bytes_of(&file)?)?,
        words: shelf.keep(&words::of_map(&file))?,
        key_frames: file.snapshot.key_frame_count(),
        maps: file.snapshot.maps().count(),
        frames,
        recorded_s: first.map_or(0.0, |first: i64| (last - first) as f64 / 1e9),
    }))
}
