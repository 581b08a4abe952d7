//! Whether the lengths of a route are metres, where it leads through several maps of the atlas.
//!
//! Tracking that is lost for a moment, such as when a phone is taken out again somewhere else, begins a map whose place and unit are
//! guesses, and leaves it as soon as it recognises where it is. A few seconds of a route may lie in such a map; the rest is as
//! good as ever.

use crate::disk::Disk;
use crate::library::replace;
use crate::reference_path::{anchor_in_map, key_frame_of, map_of, unit_of};
use cairn_atlas::Snapshot;
use cairn_guide::{Anchor, Route, RoutePoint};
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;
use std::io;
use std::path::Path;

/// So many seconds of a route may lie in maps without metres, where the rest lies in maps with metres.
const MOST_ASTRAY_S: f64 = 3.0;

/// What of a route lies in maps without metres.
struct Astray {
    /// The key frames it is anchored to there.
    anchors: BTreeSet<Anchor>,
    /// So many seconds of it.
    seconds: f64,
    /// None of it lies in a map with metres.
    wholly: bool,
}

impl Astray {
    fn of(map: &Snapshot, camera: &RectifiedCamera, route: &Route) -> Self {
        if map.is_metric(camera) {
            return Self { anchors: BTreeSet::new(), seconds: 0.0, wholly: false };
        }
        let all: BTreeSet<Anchor> = route.points.iter().map(|p| p.anchor).collect();
        let is_astray = |anchor: &Anchor| {
            let of = key_frame_of(map, *anchor).and_then(|id| map_of(map, id));
            of.is_some_and(|of| !map.is_metric_in(of, camera))
        };
        let anchors: BTreeSet<Anchor> = all.iter().copied().filter(is_astray).collect();
        let strays = |pair: &&[RoutePoint]| pair.iter().all(|p| anchors.contains(&p.anchor));
        let seconds = route.points.windows(2).filter(strays).map(|pair| pair[1].stamp - pair[0].stamp).sum();
        let wholly = !anchors.is_empty() && anchors.len() == all.len();
        Self { anchors, seconds, wholly }
    }

    /// Whether the route has metres but for what lies astray.
    fn is_little(&self) -> bool {
        self.seconds <= MOST_ASTRAY_S && !self.wholly
    }
}

/// Whether a route has metres as soon as the map has that the walker is in.
pub(crate) fn may_have_metres(map: &Snapshot, camera: &RectifiedCamera, route: &Route) -> bool {
    Astray::of(map, camera, route).is_little()
}

/// Sees to what lies astray of a route with metres that has ended, in its file too: a little of it is placed beside the rest; with more
/// the route has no metres. Returns its length then, metres or units of the map; `None` where there is nothing to do.
///
/// # Errors
/// The disk's error; the route in memory is changed.
pub(crate) fn settle_astray(
    map: &Snapshot,
    camera: &RectifiedCamera,
    route: &mut Route,
    file: Option<(&dyn Disk, &Path)>,
) -> io::Result<Option<f64>> {
    let astray = Astray::of(map, camera, route);
    if !route.header.metric || astray.anchors.is_empty() {
        return Ok(None);
    }
    if astray.is_little() {
        route.carry_over(|anchor| unit_of(map, anchor).filter(|_| !astray.anchors.contains(&anchor)));
    } else {
        route.header.metric = false;
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
