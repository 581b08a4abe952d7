//! A recorded route as a reference path in the current map: it follows when the map is corrected.

use crate::ready::readiness;
use cairn_atlas::{KeyFrameId, MapId, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_guide::{
    Anchor, CleanConfig, CleanedRoute, Facing, Ground, ManeuverPlan, ManeuverPlanConfig, ManeuverPlanError,
    PlacedPoint, ReadyStretch, Route, Travel, clean,
};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;
use std::collections::BTreeSet;

/// The reference path is rebuilt when a recorded point has moved by more than this, metres.
const MOVED_M: f64 = 0.05;
/// Interval of that check, seconds.
const MAP_CHECK_S: f64 = 1.0;

/// A route, resolved and cleaned.
pub struct ReferencePath {
    /// The ground plane of the walk.
    pub ground: Ground,
    /// Metres per unit of the map; estimated from the walking pace where the map is not metric.
    pub unit: f64,
    /// The cleaned route, in metres.
    pub cleaned: CleanedRoute,
    travel: Travel,
    anchored: Vec<PlacedPoint>,
    /// When the map was last checked; `None` to check at once.
    checked: Option<Stamp>,
    version: u64,
}

impl ReferencePath {
    /// Resolves and cleans a route. Without gravity alignment the up direction is estimated from the walk itself.
    pub fn new(map: &Snapshot, route: &Route, travel: Travel, now: Stamp) -> Self {
        let anchored = route.resolve(|a| standing(map, a));
        let poses: Vec<Se3> = anchored.iter().map(|p| p.frame_from_camera).collect();
        let ground = match map.is_gravity_aligned_throughout() {
            true => Ground::z_up(),
            false => Ground::of_walk(&poses).unwrap_or_else(|| route.header.ground()),
        };
        let unit = route.metres_per_unit();
        let cleaned = clean(&anchored, unit, &ground, &CleanConfig::default());
        Self { ground, unit, cleaned, travel, anchored, checked: Some(now), version: map.version() }
    }

    /// The maneuver plan, in metres.
    ///
    /// # Errors
    /// [`ManeuverPlanError`] for a cleaned route that is not usable, such as one with a single point.
    pub fn plan(&self) -> Result<ManeuverPlan, ManeuverPlanError> {
        ManeuverPlan::from_route(&self.cleaned, self.travel, &self.ground, &ManeuverPlanConfig::default())
    }

    /// Whether a map holds any of a route's points: then poses in it are in the route's unit of length.
    pub fn is_in(&self, snapshot: &Snapshot, route: &Route, map: MapId) -> bool {
        let anchors: BTreeSet<u32> = route.points.iter().map(|p| p.anchor.seq).collect();
        let key_frames = anchors.into_iter().filter_map(|seq| KeyFrameId::from_index(seq as usize));
        let mut alive = key_frames.filter_map(|id| snapshot.surviving_ancestor(id));
        alive.any(|(id, _)| snapshot.key_frame(id).is_some_and(|k| k.map == map))
    }

    /// The scale of the map was initialised: the reference path is rebuilt at the next check.
    pub fn found_scale(&mut self) {
        self.checked = None;
    }

    /// The rebuilt plan, when a correction of the map moved the route.
    pub fn moved(&mut self, map: &Snapshot, route: &Route, now: Stamp) -> Option<ManeuverPlan> {
        if self.checked.is_some_and(|checked| now - checked < MAP_CHECK_S) {
            return None;
        }
        self.checked = Some(now);
        if map.version() == self.version {
            return None;
        }
        self.version = map.version();
        let anchored = route.resolve(|a| standing(map, a));
        let moved = (self.anchored.iter().zip(&anchored))
            .map(|(a, b)| (a.frame_from_camera.translation - b.frame_from_camera.translation).norm())
            .fold(0.0, f64::max);
        let unit = route.metres_per_unit();
        if moved * unit <= MOVED_M && unit == self.unit {
            return None;
        }
        self.unit = unit;
        self.cleaned = clean(&anchored, self.unit, &self.ground, &CleanConfig::default());
        self.anchored = anchored;
        self.plan().ok()
    }

    /// How well the map covers the views that the camera will have, stretch by stretch of the route as recorded.
    pub fn readiness(&self, map: &Snapshot, camera: &RectifiedCamera, facing: Facing) -> Vec<ReadyStretch> {
        // On the way out again a forward-looking camera has the same views, the others the opposite ones.
        let facing = match (self.travel, facing) {
            (Travel::Home, facing) => facing,
            (Travel::Again, Facing::Home) => Facing::Back,
            (Travel::Again, _) => Facing::Home,
        };
        readiness(map, camera, &self.anchored, self.unit, &self.ground, facing)
    }

    /// The corners of the cleaned route in the map's own units.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> {
        self.cleaned.points.iter().map(|p| p / self.unit)
    }
}

/// The pose of the keyframe that a route point is anchored to, with its unit of length.
pub fn standing(map: &Snapshot, anchor: Anchor) -> Option<Sim3> {
    map.world_from_here(KeyFrameId::from_index(anchor.seq as usize)?)
}
