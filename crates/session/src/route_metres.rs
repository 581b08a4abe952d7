//! Whether the lengths of a route are metres, where it leads through several maps of the atlas.
//!
//! Tracking that is lost for a moment, such as when a phone is taken out again somewhere else, begins a map whose place and unit are
//! guesses, and leaves it as soon as it recognises where it is. A few seconds of a route may lie in such a map; the rest is as
//! good as ever.

use crate::disk::Disk;
use crate::library::replace;
use crate::reference_path::{anchor_in_map, key_frame_of, map_of, unit_of};
use cairn_atlas::Snapshot;
use cairn_guide::{Anchor, Route};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// So many seconds of a route may lie in maps without metres, where the rest lies in maps with metres.
const MOST_ASTRAY_S: f64 = 3.0;

/// The key frames of a route that lie in maps without metres, and how many seconds of it are anchored to them.
fn astray(map: &Snapshot, camera: &RectifiedCamera, route: &Route) -> (BTreeSet<Anchor>, f64) {
    if map.is_metric(camera) {
        return (BTreeSet::new(), 0.0);
    }
    let all: BTreeSet<Anchor> = route.points.iter().map(|p| p.anchor).collect();
    let is_astray = |anchor: &Anchor| {
        let of = key_frame_of(map, *anchor).and_then(|id| map_of(map, id));
        of.is_some_and(|of| !map.is_metric_in(of, camera))
    };
    let found: BTreeSet<Anchor> = all.into_iter().filter(is_astray).collect();
    let pairs = route.points.windows(2).filter(|pair| pair.iter().all(|p| found.contains(&p.anchor)));
    let seconds = pairs.map(|pair| pair[1].stamp - pair[0].stamp).sum();
    (found, seconds)
}

/// Whether a route has metres as soon as the map has that the walker is in.
pub(crate) fn may_have_metres(map: &Snapshot, camera: &RectifiedCamera, route: &Route) -> bool {
    astray(map, camera, route).1 <= MOST_ASTRAY_S
}

/// Places the few points of a route with metres that lie in maps without beside those that do not, in its file too. Returns its length
/// then, metres; `None` where there is nothing to do.
///
/// # Errors
/// The disk's error; the route in memory is changed.
pub(crate) fn carry_over_astray(
    map: &Snapshot,
    camera: &RectifiedCamera,
    route: &mut Route,
    file: Option<(&dyn Disk, &Path)>,
) -> io::Result<Option<f64>> {
    if !route.header.metric {
        return Ok(None);
    }
    let (anchors, seconds) = astray(map, camera, route);
    if anchors.is_empty()
        || seconds > MOST_ASTRAY_S
        || route.carry_over(|anchor| unit_of(map, anchor).filter(|_| !anchors.contains(&anchor))) == 0
    {
        return Ok(None);
    }
    if let Some((disk, path)) = file {
        replace(disk, path, route)?;
    }
    Ok(Some(length_in_map(map, route)))
}

/// The length of a route as it lies in the map, in units of that.
pub(crate) fn length_in_map(map: &Snapshot, route: &Route) -> f64 {
    let placed = route.resolve(|anchor| anchor_in_map(map, anchor));
    let steps =
        placed.windows(2).map(|w| w[1].frame_from_camera.translation - w[0].frame_from_camera.translation);
    steps.map(|step| step.norm()).sum()
}
