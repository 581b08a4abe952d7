//! A recorded way as a route in the map of now: it follows when the map moves.

use crate::ready::readiness;
use cairn_atlas::{KeyFrameId, Snapshot};
use cairn_geometry::{Se3, Sim3, Vec3};
use cairn_guide::{
    Anchor, CleanConfig, CleanedRoute, Facing, Ground, ManeuverPlan, ManeuverPlanConfig, ManeuverPlanError,
    PlacedPoint, ReadyStretch, Route, Travel, clean,
};
use cairn_sensor::Stamp;
use cairn_vision::RectifiedCamera;

/// The route is made anew when a recorded point has moved by more than this, metres,
const MOVED_M: f64 = 0.05;
/// looked at so often, seconds.
const LOOK_AT_MAP_S: f64 = 1.0;

/// A way, cleaned and placed.
pub struct ReferencePath {
    /// The ground of the walk.
    pub ground: Ground,
    /// Metres per unit of the map; a guess from the pace where the map has no metres.
    pub unit: f64,
    /// The cleaned way, in metres.
    pub cleaned: CleanedRoute,
    travel: Travel,
    anchored: Vec<PlacedPoint>,
    /// When the map was looked at last; at once where it is not known.
    looked: Option<Stamp>,
    version: u64,
}

impl ReferencePath {
    /// Places and cleans a way. Which way is up, the walk itself tells where the map does not know.
    pub fn new(map: &Snapshot, route: &Route, travel: Travel, now: Stamp) -> Self {
        let anchored = route.resolve(|a| standing(map, a));
        let poses: Vec<Se3> = anchored.iter().map(|p| p.frame_from_camera).collect();
        let ground = match map.is_gravity_aligned_throughout() {
            true => Ground::z_up(),
            false => Ground::of_walk(&poses).unwrap_or_else(|| route.header.ground()),
        };
        let unit = route.metres_per_unit();
        let cleaned = clean(&anchored, unit, &ground, &CleanConfig::default());
        Self { ground, unit, cleaned, travel, anchored, looked: Some(now), version: map.version() }
    }

    /// The route, in metres.
    pub fn plan(&self) -> Result<ManeuverPlan, ManeuverPlanError> {
        ManeuverPlan::from_route(&self.cleaned, self.travel, &self.ground, &ManeuverPlanConfig::default())
    }

    /// The scale of the map was found: the route is due at once.
    pub fn found_scale(&mut self) {
        self.looked = None;
    }

    /// The route once more, when the map has moved under it.
    pub fn moved(&mut self, map: &Snapshot, route: &Route, now: Stamp) -> Option<ManeuverPlan> {
        if self.looked.is_some_and(|looked| now - looked < LOOK_AT_MAP_S) {
            return None;
        }
        self.looked = Some(now);
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

    /// What the map knows of the views that the camera will have, stretch by stretch of the way as recorded.
    pub fn readiness(&self, map: &Snapshot, camera: &RectifiedCamera, facing: Facing) -> Vec<ReadyStretch> {
        // On the way out again the camera that looks ahead looks as it did, the others look the other way.
        let facing = match (self.travel, facing) {
            (Travel::Home, facing) => facing,
            (Travel::Again, Facing::Home) => Facing::Back,
            (Travel::Again, _) => Facing::Home,
        };
        readiness(map, camera, &self.anchored, self.unit, &self.ground, facing)
    }

    /// The corners of the cleaned way in the map's own units.
    pub fn corners(&self) -> impl Iterator<Item = Vec3> {
        self.cleaned.points.iter().map(|p| p / self.unit)
    }
}

/// Where a key frame that a way hangs on stands in the map, with its unit of length.
pub fn standing(map: &Snapshot, anchor: Anchor) -> Option<Sim3> {
    map.world_from_here(KeyFrameId::from_index(anchor.seq as usize)?)
}
